"""The claims, group by group: what is printed, what of ours it is held against, by which rule."""
