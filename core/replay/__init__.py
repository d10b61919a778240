"""Can the robot do it? Checks of a trajectory against the robot's kinematics, and its replay in a physics engine."""
