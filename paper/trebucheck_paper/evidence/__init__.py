"""What the claims are judged by: the printed numbers, the throws with their quantities, and the rules of a verdict."""
