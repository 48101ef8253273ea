"""Model-equivalence check, onset of a deviation from the reference, and suspected causes."""
