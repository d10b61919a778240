"""Names of the fields of a `JointTrajectory` that hold a row a frame."""

ARRAYS = (
    "time",
    "position",
    "velocity",
    "base_position",
    "base_orientation",
    "base_linear_velocity",
    "base_angular_velocity",
)
"""Numbers; `status`, which marks frames, beside them."""
