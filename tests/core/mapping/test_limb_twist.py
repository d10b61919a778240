"""The hinge of limbs that flex, straighten, overstretch and are strapped askew, with the true hinge known."""

from __future__ import annotations

import numpy as np
import pytest
from retarget.core import rotations
from retarget.core.mapping.limb_twist import WINDOW_S, frame_from_bone, hinge_directions
from retarget.core.timebase import minimum_jerk
from retarget.core.types import Array

RATE_HZ = 60.0
X, Y, Z = np.eye(3)
LIMBS = {
    # T-pose bone, hinge, and the sense in which flexing turns the lower bone about the hinge.
    "left arm": (Y, Z, -1.0),
    "right arm": (-Y, Z, 1.0),
    "leg": (-Z, Y, 1.0),
}


def limb(kind: str, time: Array, bend_deg: Array, misfit_deg: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
    """Upper bone, lower bone, own hinge and true hinge, each (T, 3), of a limb whose upper bone swings about in space.

    bend_deg: flexion, (T,). misfit_deg: by how much the segment's own twist is off, turned about the upper bone.
    """
    bone, hinge, flexion = LIMBS[kind]
    swing = rotations.exp(
        np.stack([0.9 * np.sin(1.3 * time), 0.7 * np.cos(0.8 * time + 1), 0.5 * np.sin(0.6 * time + 2)], axis=1)
    )
    bent = rotations.exp(np.radians(flexion * bend_deg)[:, None] * hinge)
    askew = rotations.exp(np.radians(np.broadcast_to(misfit_deg, time.shape))[:, None] * bone)
    return (
        rotations.rotate(swing, bone),
        rotations.rotate(swing, rotations.rotate(bent, bone)),
        rotations.rotate(swing, rotations.rotate(askew, hinge)),
        rotations.rotate(swing, hinge),
    )


def degrees_between(a: Array, b: Array) -> Array:
    return np.degrees(rotations.vector_angle(a, b))


def twist_rate(time: Array, upper: Array, own: Array, hinge: Array) -> Array:
    """Rate in deg/s of the hinge's angle about the upper bone, counted from the own hinge."""
    angle = np.arctan2(np.einsum("ti,ti->t", hinge, np.cross(upper, own)), np.einsum("ti,ti->t", hinge, own))
    return np.degrees(np.diff(np.unwrap(angle))) / np.diff(time)


def flexing(time: Array, lowest_deg: float, highest_deg: float) -> Array:
    """Flexion that goes back and forth smoothly once in two seconds."""
    return lowest_deg + (highest_deg - lowest_deg) * 0.5 * (1 - np.cos(np.pi * time))


@pytest.mark.parametrize("kind", LIMBS)
@pytest.mark.parametrize(("low", "high"), [(20, 140), (0, 140), (0, 3), (0, 0), (90, 90)])
def test_where_plane_and_own_twist_agree_the_hinge_is_exact(kind: str, low: float, high: float) -> None:
    time = np.arange(240) / RATE_HZ
    upper, lower, own, true = limb(kind, time, flexing(time, low, high))
    found = hinge_directions(time, upper, lower, own, LIMBS[kind][2])
    assert rotations.vector_angle(found, true).max() < 1e-9


@pytest.mark.parametrize("kind", LIMBS)
def test_unit_and_perpendicular_to_the_bone(kind: str) -> None:
    time = np.arange(240) / RATE_HZ
    upper, lower, own, _ = limb(kind, time, flexing(time, -10, 120), misfit_deg=40 * np.sin(time))
    tilted = own + 0.3 * upper  # an own hinge that isn't quite perpendicular
    found = hinge_directions(time, upper, lower, tilted / np.linalg.norm(tilted, axis=1, keepdims=True), LIMBS[kind][2])
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-12
    assert np.abs(np.einsum("ti,ti->t", found, upper)).max() < 1e-12


@pytest.mark.parametrize("kind", LIMBS)
@pytest.mark.parametrize("misfit_deg", [-25.0, 10.0, 40.0, 75.0, 97.0, -110.0, 150.0])
def test_a_bent_limb_shows_its_hinge_however_wrong_the_own_twist(kind: str, misfit_deg: float) -> None:
    """Real recordings have own twists that are off by 40 to 97° from planes that are plain to see."""
    time = np.arange(240) / RATE_HZ
    upper, lower, own, true = limb(kind, time, flexing(time, 70, 110), misfit_deg)
    found = hinge_directions(time, upper, lower, own, LIMBS[kind][2])
    assert degrees_between(found, true).max() < 2.0


@pytest.mark.parametrize("kind", LIMBS)
@pytest.mark.parametrize("misfit_deg", [-30.0, 20.0])
def test_a_straight_limb_takes_its_own_twist(kind: str, misfit_deg: float) -> None:
    time = np.arange(240) / RATE_HZ
    upper, lower, own, _ = limb(kind, time, np.full(240, 1.0), misfit_deg)
    found = hinge_directions(time, upper, lower, own, LIMBS[kind][2])
    assert degrees_between(found, own).max() < 1.0


@pytest.mark.parametrize("kind", LIMBS)
@pytest.mark.parametrize("lowest_deg", [0.0, -5.0, -12.0], ids=["straight", "a little over", "overstretched"])
@pytest.mark.parametrize("misfit_deg", [-15.0, 4.0, 40.0])
def test_through_straight_and_beyond_without_a_jump(kind: str, lowest_deg: float, misfit_deg: float) -> None:
    """Flexed, straight (or overstretched) and flexed again, with a fixed shoulder twist and a carrying angle.

    The plane's normal itself turns around there by 180° within one frame. The hinge stays between the own twist and the true hinge, and
    crosses that span in no less than half the averaging window.
    """
    time = np.arange(360) / RATE_HZ
    upper, lower, own, true = limb(kind, time, flexing(time, lowest_deg, 100), misfit_deg)
    found = hinge_directions(time, upper, lower, own, LIMBS[kind][2])
    assert degrees_between(found, true).max() < abs(misfit_deg) + 1e-6
    assert degrees_between(found, own).max() < abs(misfit_deg) + 1e-6
    assert np.abs(twist_rate(time, upper, own, found)).max() < abs(misfit_deg) / (WINDOW_S / 2)
    if lowest_deg < 0:
        normal = LIMBS[kind][2] * np.cross(upper, lower)
        assert degrees_between(normal[1:], normal[:-1]).max() > 170, "the case is one that jumps"


def test_noise_of_a_nearly_straight_limb_is_not_amplified() -> None:
    """0.3° of noise on the lower bone swings the plane of a limb bent by 1° through any angle; the hinge stays within 5° of its own twist."""
    time = np.arange(600) / RATE_HZ
    upper, lower, own, _ = limb("left arm", time, np.full(600, 1.0))
    noisy = lower + np.random.default_rng(0).normal(scale=np.radians(0.3), size=lower.shape)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    plane = -np.cross(upper, noisy)
    found = hinge_directions(time, upper, noisy, own, -1.0)
    assert degrees_between(plane, own).max() > 30
    assert degrees_between(found, own).max() < 5
    assert np.abs(twist_rate(time, upper, own, found)).max() < 20


def test_no_lag() -> None:
    """A plane whose misfit swings: found from the clip run backward, it is the same hinge, frame for frame."""
    time = np.arange(300) / RATE_HZ
    upper, lower, own, _ = limb("right arm", time, flexing(time, 10, 100), 30 * np.sin(4 * time))
    forward = hinge_directions(time, upper, lower, own, 1.0)
    backward = hinge_directions(time, upper[::-1], lower[::-1], own[::-1], 1.0)
    assert np.abs(forward - backward[::-1]).max() < 1e-13


def test_beyond_the_window_the_rest_of_the_clip_does_not_matter() -> None:
    time = np.arange(300) / RATE_HZ
    upper, lower, own, _ = limb("leg", time, flexing(time, -5, 100), 30 * np.sin(4 * time))
    whole = hinge_directions(time, upper, lower, own, 1.0)
    part = slice(120, 250)
    cut = hinge_directions(time[part], upper[part], lower[part], own[part], 1.0)
    reach = round(WINDOW_S * RATE_HZ)
    assert np.abs(cut[reach:-reach] - whole[part][reach:-reach]).max() < 1e-13


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_of_a_few_frames(frames: int) -> None:
    time = np.arange(frames) / RATE_HZ
    upper, lower, own, true = limb("left arm", time, np.full(frames, 60.0))
    assert rotations.vector_angle(hinge_directions(time, upper, lower, own, -1.0), true).max() < 1e-9


class TestFrameFromBone:
    @pytest.mark.parametrize("left", [True, False])
    @pytest.mark.parametrize("arm", [True, False])
    def test_t_pose_is_the_identity(self, left: bool, arm: bool) -> None:
        bone, hinge = (((Y if left else -Y), Z)) if arm else (-Z, Y)
        q = frame_from_bone(np.tile(bone, (3, 1)), np.tile(hinge, (3, 1)), left=left, arm=arm)
        assert np.array_equal(q, np.tile([1.0, 0, 0, 0], (3, 1)))

    @pytest.mark.parametrize("left", [True, False])
    @pytest.mark.parametrize("arm", [True, False])
    def test_the_bone_exactly_and_the_hinge_as_near_as_it_goes(self, left: bool, arm: bool) -> None:
        bone, own_hinge = (((Y if left else -Y), Z)) if arm else (-Z, Y)
        time = np.arange(100) / RATE_HZ
        truth = rotations.exp(np.stack([2 * np.sin(time), 3 * time, np.cos(2 * time)], axis=1))
        wanted = rotations.rotate(truth, own_hinge) + 0.4 * rotations.rotate(truth, bone)  # leans along the bone
        q = frame_from_bone(rotations.rotate(truth, bone), wanted, left=left, arm=arm)
        assert rotations.angle(q, truth).max() < 1e-14
        assert (np.einsum("ti,ti->t", q[1:], q[:-1]) > 0).all()


def test_flexion_at_minimum_jerk_keeps_the_hinge_through_a_stop() -> None:
    """A limb that comes to rest straight and stays there: no drift while it rests."""
    time = np.arange(360) / RATE_HZ
    bend = 100 * (1 - minimum_jerk((time - 1) / 1.0))
    upper, lower, own, true = limb("left arm", time, bend, 20.0)
    found = hinge_directions(time, upper, lower, own, -1.0)
    assert degrees_between(found, true)[:30].max() < 1.0
    assert degrees_between(found, own)[150:].max() < 1e-9
