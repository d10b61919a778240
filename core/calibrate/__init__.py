"""Who the operator is, from three poses: shoulders, arm lengths, facing direction, and how each tracker is strapped on [Lim2022 sec. II-B].

`operator` makes a `Calibration` of tracker recordings or of a motion; `apply` turns later recordings of the same trackers into a motion.
"""
