"""`trebucheck throw`: the pictures and tables of one throw."""
