"""The claims, as rows of data and rules: a module for each part of the paper."""
