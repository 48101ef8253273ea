"""The reference motion by an adaptive Taylor integrator (heyoka, optional): an independent integrator."""
