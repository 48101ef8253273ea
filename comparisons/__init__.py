"""Tell whether, how well and why (not) the engines agree, and how that is shown."""
