"""The reference motion by heyoka's adaptive Taylor integrator (optional)."""
