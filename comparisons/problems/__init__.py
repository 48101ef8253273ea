"""The problem library solved by the reference: its figures and conditions checked, and shown."""
