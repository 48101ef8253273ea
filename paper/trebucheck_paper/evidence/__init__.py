"""Evidence of the verdicts: printed numbers, throws with their quantities, and the rules."""
