"""Every machine the paper names, and what it makes of its energy."""
