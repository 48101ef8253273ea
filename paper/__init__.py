"""The paper, claim by claim: its figures drawn again, its numbers judged by stated rules."""
