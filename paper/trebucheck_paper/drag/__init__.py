"""The drag area behind Table II."""
