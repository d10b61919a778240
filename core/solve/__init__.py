"""Solvers: `Targets` → joint motion. One QP a step; which steps, and what limits them, is each solver's business."""
