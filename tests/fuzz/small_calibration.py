"""A calibration as text, made of round numbers."""

from __future__ import annotations

from retarget.core.calibration import SIDES, ArmCalibration, Calibration


def small_calibration() -> str:
    """JSON of an operator with arms of 60 cm."""
    arms = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        shoulder = [0.0, 0.2 * sign, 0.4]
        arms[side] = ArmCalibration(
            hand_points=[[0.0, 0.2 * sign, -0.2], [0.0, 0.8 * sign, 0.4], [0.6, 0.2 * sign, 0.4]],  # type: ignore[arg-type]  # made an array there
            shoulder=shoulder,  # type: ignore[arg-type]  # likewise
            length_m=0.6,
            angles_deg=(90.0, 90.0, 90.0),
            offsets_m=(0.0, 0.0, 0.0),
        )
    turn = [1.0, 0.0, 0.0, 0.0]
    return Calibration(
        arms=arms,
        origin=[0.0, 0.0, 0.9],  # type: ignore[arg-type]  # likewise
        heading_rad=0.1,
        chest_position=[0.0, 0.0, 0.4],  # type: ignore[arg-type]  # likewise
        chest_orientation=turn,  # type: ignore[arg-type]  # likewise
        still_orientation={"T8": turn, "LeftHand": turn},  # type: ignore[dict-item]  # likewise
        trackers={"T8": "LHR-1", "LeftHand": "LHR-2"},
        tracker_rotation={"T8": turn, "LeftHand": turn},  # type: ignore[dict-item]  # likewise
        hand_offset_m={"Left": [0.0, 0.0, 0.1]},  # type: ignore[dict-item]  # likewise
        windows_s={"still": (0.0, 1.0), "tpose": (2.0, 3.0), "forward": (4.0, 5.0)},
        input_sha256={"still": "ab12"},
        residuals={"shoulder_spread_m/Left": 0.01},
        warnings=("no tracker on Head",),
    ).to_json()
