"""Replay of trajectories in MuJoCo: models, checks, torque control, pictures."""
