"""A rolling machine whose largest kinetic energy comes at its best release."""
