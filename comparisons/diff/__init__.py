"""`trebucheck diff`: two comparisons of the same mechanisms, what moved and what broke."""
