"""The paper's start angles, from what it prints."""
