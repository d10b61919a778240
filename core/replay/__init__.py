"""Replay in MuJoCo: the robot as a simulation model, and checks of a trajectory on it."""
