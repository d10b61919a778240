"""The retargeting itself: types, rotations, mappings, solvers. Numpy at the bottom; heavy libraries only in leaf modules."""
