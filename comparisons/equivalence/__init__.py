"""The model-equivalence check: is the model that an engine has built the same machine, before any motion?"""
