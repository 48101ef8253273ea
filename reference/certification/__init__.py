"""Independent computations of the same quantities, and the certificates that follow from them."""
