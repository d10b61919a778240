"""Rotations against SciPy, pinocchio and closed forms. Quaternions wxyz; `scipy()` turns them into SciPy's own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import ArrayLike
from retarget.core import rotations
from retarget.core.types import Array
from scipy.spatial.transform import Rotation, Slerp

X, Y, Z = np.eye(3)


def scipy(quaternion: ArrayLike) -> Rotation:
    return Rotation.from_quat(np.roll(np.asarray(quaternion), -1, axis=-1))


def turn(axis: ArrayLike, degrees: ArrayLike) -> Array:
    """Quaternion of a rotation by `degrees` about `axis`, from its definition."""
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    half = np.radians(np.asarray(degrees, float))[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * unit], axis=-1)


def random_quaternions(*shape: int, seed: int = 7) -> Array:
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def assert_same_rotation(found: ArrayLike, expected: ArrayLike, tolerance: float) -> None:
    """Equal up to the sign, which is no part of the rotation."""
    a, b = np.broadcast_arrays(found, expected)
    difference = np.minimum(np.abs(a - b).max(axis=-1), np.abs(a + b).max(axis=-1))
    assert difference.max() <= tolerance, difference.max()


coordinates = st.floats(-1, 1, allow_subnormal=False)
quaternions = (
    npst.arrays(float, 4, elements=coordinates)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
directions = npst.arrays(float, 3, elements=coordinates).filter(lambda v: np.linalg.norm(v) > 0.1)


class TestProducts:
    def test_multiply_turns_by_the_right_factor_first(self) -> None:
        a, b = random_quaternions(50, seed=1), random_quaternions(50, seed=2)
        expected = (scipy(a) * scipy(b)).as_matrix()
        assert np.abs(rotations.to_matrix(rotations.multiply(a, b)) - expected).max() < 1e-14

    def test_multiply_is_hamiltons_product(self) -> None:
        one, i, j, k = np.eye(4)
        for left, right, product in ((i, j, k), (j, k, i), (k, i, j), (j, i, -k), (i, i, -one)):
            assert rotations.multiply(left, right).tolist() == product.tolist()

    def test_shapes_broadcast(self) -> None:
        q, v = random_quaternions(5, 3), np.random.default_rng(3).normal(size=(5, 1, 3))
        one = random_quaternions(seed=4)
        assert rotations.multiply(one, q).shape == (5, 3, 4)
        assert rotations.rotate(q, v).shape == (5, 3, 3)
        assert np.allclose(rotations.rotate(q, v)[4, 2], scipy(q[4, 2]).apply(v[4, 0]), rtol=0, atol=1e-14)

    @given(quaternions)
    def test_conjugate_is_the_inverse(self, q: Array) -> None:
        product = rotations.multiply(q, rotations.conjugate(q))
        assert np.abs(product - [1, 0, 0, 0]).max() < 1e-15

    @given(quaternions, directions)
    def test_rotate_is_what_scipy_does(self, q: Array, v: Array) -> None:
        assert np.abs(rotations.rotate(q, v) - scipy(q).apply(v)).max() < 1e-14

    @given(quaternions, st.floats(1e-3, 1e3))
    def test_normalize_keeps_the_direction(self, q: Array, length: float) -> None:
        assert np.abs(rotations.normalize(length * q) - q).max() < 1e-15

    def test_normalize_of_zero_is_nan_and_no_warning(self, recwarn: pytest.WarningsRecorder) -> None:
        assert np.isnan(rotations.normalize([[0, 0, 0, 0], [0, 2, 0, 0]])).tolist() == [[True] * 4, [False] * 4]
        assert not recwarn.list


class TestMatrices:
    def test_to_matrix(self) -> None:
        q = random_quaternions(100)
        assert np.abs(rotations.to_matrix(q) - scipy(q).as_matrix()).max() < 1e-15

    def test_from_matrix(self) -> None:
        q = random_quaternions(20, 5)
        found = rotations.from_matrix(scipy(q.reshape(-1, 4)).as_matrix().reshape(20, 5, 3, 3))
        assert_same_rotation(found, q, 1e-14)
        assert (found[..., 0] >= 0).all()

    @pytest.mark.parametrize("axis", [X, Y, Z, X + Y, Y - Z, X + Y + Z, [1, -2, 3], [1e-9, 1, 0]], ids=str)
    @pytest.mark.parametrize("short_of_half_turn_deg", [0.0, 1e-10, 1e-6, -1e-6, 1.0])
    def test_from_matrix_near_half_turns(self, axis: Array, short_of_half_turn_deg: float) -> None:
        q = turn(axis, 180 - short_of_half_turn_deg)
        assert_same_rotation(rotations.from_matrix(scipy(q).as_matrix()), q, 5e-16)


class TestLogarithm:
    def test_log_and_exp(self) -> None:
        q = random_quaternions(200)
        vector = scipy(q).as_rotvec()
        assert np.abs(rotations.log(q) - vector).max() < 1e-14
        assert_same_rotation(rotations.exp(vector), q, 1e-15)

    @pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-15, 2e-12, 3e-12, 1e-8, 1e-3, 3.0, np.pi - 1e-9, np.pi])
    def test_log_undoes_exp_at_every_size(self, angle: float) -> None:
        vector = angle * np.array([2.0, -1.0, 2.0]) / 3
        found = rotations.log(rotations.exp(vector))
        assert np.abs(found - vector).max() <= 4e-16 * angle

    def test_both_signs_have_one_logarithm_of_at_most_half_a_turn(self) -> None:
        q = random_quaternions(50)
        assert np.abs(rotations.log(q) - rotations.log(-q)).max() == 0
        assert np.linalg.norm(rotations.log(turn(X, 350.0))) == pytest.approx(np.radians(10), abs=1e-15)

    def test_exp_of_more_than_a_turn(self) -> None:
        assert_same_rotation(rotations.exp(np.radians(400) * Y), turn(Y, 40.0), 1e-15)


class TestAngles:
    @pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 0.7, np.pi / 2, np.pi - 1e-9, np.pi])
    def test_angle_between_rotations(self, angle: float) -> None:
        a = random_quaternions(20)
        b = rotations.multiply(a, rotations.exp(angle * np.array([0.6, 0.0, -0.8])))
        assert np.abs(rotations.angle(a, b) - angle).max() < 5e-16
        assert np.abs(rotations.angle(a, -b) - angle).max() < 5e-16

    @pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-9, 0.3, 2.0, np.pi - 1e-9, np.pi])
    def test_angle_between_vectors(self, angle: float) -> None:
        other = np.array([np.cos(angle), np.sin(angle), 0.0])
        assert rotations.vector_angle(5 * X, 0.2 * other) == pytest.approx(angle, rel=1e-9, abs=0)

    def test_where_the_arc_cosine_fails(self) -> None:
        """The reason not to write arccos(u·v): it is blind to small angles."""
        other = np.array([np.cos(1e-9), np.sin(1e-9), 0.0])
        assert np.arccos(X @ other) == 0.0
        assert rotations.vector_angle(X, other) == pytest.approx(1e-9, rel=1e-12)

    def test_no_angle_with_a_vector_that_has_no_direction(self) -> None:
        found = rotations.vector_angle([X, [0, 0, 0], [np.nan, 1, 0]], Y)
        assert np.isnan(found).tolist() == [False, True, True]


class TestContinuity:
    def test_random_flips_are_undone(self) -> None:
        generator = np.random.default_rng(5)
        rates = generator.normal(size=(4, 3))
        smooth = rotations.exp(np.linspace(0, 9, 300)[:, None, None] * rates)  # up to three turns, through w = 0
        flipped = smooth * generator.choice([-1.0, 1.0], size=(300, 4, 1))
        found = rotations.make_continuous(flipped)
        assert np.array_equal(found, smooth * (flipped[0, :, :1] / smooth[0, :, :1]).round())
        assert np.abs(np.diff(found, axis=0)).max() < 0.1

    @given(npst.arrays(float, st.tuples(st.integers(1, 12), st.integers(1, 3), st.just(4)), elements=coordinates))
    def test_idempotent_the_same_rotations_and_the_first_sign(self, values: Array) -> None:
        found = rotations.make_continuous(values)
        assert np.array_equal(rotations.make_continuous(found), found)
        assert np.array_equal(np.abs(found), np.abs(values))
        assert np.array_equal(found[0], values[0])
        assert (np.einsum("tsi,tsi->ts", found[1:], found[:-1]) >= 0).all()

    def test_the_argument_is_left_alone(self) -> None:
        values = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]])
        rotations.make_continuous(values)
        assert values[1, 0] == -1


class TestSlerp:
    def test_against_scipy(self) -> None:
        a, b = random_quaternions(30, seed=8), random_quaternions(30, seed=9)
        fraction = np.random.default_rng(1).uniform(size=30)
        expected = [
            Slerp([0, 1], Rotation.concatenate([scipy(p), scipy(q)]))(f).as_quat()[[3, 0, 1, 2]]
            for p, q, f in zip(a, b, fraction, strict=True)
        ]
        assert_same_rotation(rotations.slerp(a, b, fraction), expected, 1e-14)
        assert_same_rotation(rotations.slerp(a, -b, fraction), expected, 1e-14)

    @pytest.mark.parametrize("whole", [1e-12, 1e-8, 1e-3, 1.0, np.pi - 1e-6])
    def test_a_third_of_the_way_is_a_third_of_the_angle(self, whole: float) -> None:
        start = random_quaternions()
        end = rotations.multiply(start, rotations.exp(whole * Z))
        third = rotations.slerp(start, end, 1 / 3)
        assert rotations.angle(start, third) == pytest.approx(whole / 3, rel=1e-9, abs=3e-16)

    def test_ends_and_broadcasting(self) -> None:
        a, b = random_quaternions(6, 2, seed=1), random_quaternions(6, 2, seed=2)
        fraction = np.array([0, 1, 0, 1, 0, 1.0])[:, None]
        expected = np.where(fraction[..., None] == 0, a, b)
        assert_same_rotation(rotations.slerp(a, b, fraction), expected, 1e-15)


class TestAngularVelocity:
    @pytest.mark.parametrize("sign_flips", [False, True])
    def test_exact_at_constant_rate_in_the_world_frame_for_any_frame_times(self, sign_flips: bool) -> None:
        generator = np.random.default_rng(11)
        time = np.cumsum(generator.uniform(0.01, 0.1, size=60))
        omega = np.array([0.3, -2.0, 1.1])
        start = random_quaternions()  # in the body's own frame the same motion has another angular velocity
        q = rotations.multiply(rotations.exp(time[:, None] * omega), start)
        if sign_flips:
            q = q * generator.choice([-1.0, 1.0], size=(60, 1))
        assert np.abs(rotations.angular_velocity(time, q) - omega).max() < 1e-12

    def test_exact_inside_at_constant_acceleration_about_one_axis(self) -> None:
        time = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.1, size=40))
        q = rotations.exp((0.4 * time + 1.5 * time**2)[:, None] * Y)
        found = rotations.angular_velocity(time, q)
        assert np.abs(found[1:-1] - (0.4 + 3.0 * time)[1:-1, None] * Y).max() < 1e-12
        one_sided = 0.4 + 1.5 * (time[0] + time[1])
        assert found[0] == pytest.approx(one_sided * Y, abs=1e-12)

    def test_second_order_on_a_tumbling_body(self) -> None:
        """Euler angles with known rates: the error falls with the square of the step."""

        def error(count: int) -> float:
            t = np.linspace(0, 1, count)
            q = rotations.multiply(rotations.exp((3 * t)[:, None] * Z), rotations.exp(np.sin(4 * t)[:, None] * X))
            spin = rotations.rotate(rotations.exp((3 * t)[:, None] * Z), (4 * np.cos(4 * t))[:, None] * X)
            return float(np.abs(rotations.angular_velocity(t, q) - (3 * Z + spin))[1:-1].max())

        assert error(201) / error(401) == pytest.approx(4, rel=0.05)

    def test_one_and_two_frames_and_many_segments(self) -> None:
        q = random_quaternions(1, 3)
        assert np.array_equal(rotations.angular_velocity([0.0], q), np.zeros((1, 3, 3)))
        two = np.concatenate([q, rotations.multiply(rotations.exp(0.2 * X), q)])
        assert np.abs(rotations.angular_velocity([1.0, 1.1], two) - 2.0 * X).max() < 1e-13

    def test_which_way_an_arm_turns(self) -> None:
        """X forward, Y left, Z up: the right arm hangs along -z and is raised to -y, a turn about -x; the left one about +x."""
        time = np.linspace(0, 1, 20)
        lifted = np.radians(90) * (1 - time)[:, None]
        for side, bone, about in (("right", -Y, -X), ("left", Y, X)):
            q = rotations.exp(lifted * -about)
            path = rotations.rotate(q, bone)
            assert path[0] == pytest.approx(-Z, abs=1e-15), side
            assert path[-1] == pytest.approx(bone, abs=1e-15), side
            assert rotations.angular_velocity(time, q)[7] == pytest.approx(np.radians(90) * about, abs=1e-12), side


class TestRollPitchYaw:
    def test_as_in_pinocchio_and_urdf(self) -> None:
        for rpy in np.random.default_rng(3).uniform(-np.pi, np.pi, size=(50, 3)):
            found = rotations.to_matrix(rotations.from_rpy(rpy))
            assert np.abs(found - pin.rpy.rpyToMatrix(rpy)).max() < 1e-15

    def test_batches(self) -> None:
        rpy = np.random.default_rng(4).uniform(-3, 3, size=(4, 5, 3))
        expected = Rotation.from_euler("xyz", rpy.reshape(-1, 3)).as_matrix().reshape(4, 5, 3, 3)
        assert np.abs(rotations.to_matrix(rotations.from_rpy(rpy)) - expected).max() < 1e-15

    @pytest.mark.parametrize("pitch", [0.0, 1.0, -1.5, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 1e-9 - np.pi / 2])
    def test_back_again_even_where_two_axes_fall_together(self, pitch: float) -> None:
        for roll, yaw in np.random.default_rng(5).uniform(-np.pi, np.pi, size=(50, 2)):
            turn = pin.rpy.rpyToMatrix(np.array([roll, pitch, yaw]))
            found = rotations.to_rpy(rotations.from_matrix(turn))
            assert np.abs(pin.rpy.rpyToMatrix(found) - turn).max() < 2e-15
            if abs(pitch) < 1.5:
                assert found == pytest.approx([roll, pitch, yaw], abs=1e-14)


class TestYaw:
    @given(st.floats(-179.9, 180))
    def test_turning_left_is_positive(self, degrees: float) -> None:
        q = turn(Z, degrees)
        assert rotations.yaw(q) == pytest.approx(np.radians(degrees), abs=1e-14)
        facing = rotations.rotate(q, X)
        assert np.arctan2(facing[1], facing[0]) == pytest.approx(np.radians(degrees), abs=1e-14)

    @given(quaternions)
    def test_both_signs_of_a_quaternion_face_one_way(self, q: Array) -> None:
        found = rotations.yaw(q)
        assert found == rotations.yaw(-q)
        assert -np.pi < found <= np.pi

    @pytest.mark.parametrize("q", [[0, 0, 0, 1], [0, 0, 0, -1], [-0.0, 0, 0, -1], [1e-17, 0, 0, -1], [-1e-17, 0, 0, 1]])
    def test_facing_backward_is_plus_pi(self, q: list[float]) -> None:
        assert rotations.yaw(q) == np.pi

    @given(quaternions.filter(lambda q: np.hypot(q[0], q[3]) > 1e-3), st.floats(-4, 4))
    def test_a_turn_of_the_world_adds_to_it(self, q: Array, by: float) -> None:
        turned = rotations.yaw(rotations.multiply(rotations.exp(by * Z), q))
        rest = turned - rotations.yaw(q) - by
        assert abs(rest - 2 * np.pi * np.round(rest / (2 * np.pi))) < 1e-11

    @pytest.mark.parametrize("bend_deg", [0, 45, 89.9999, 90, 90.0001, 120, 179])
    @pytest.mark.parametrize("heading_deg", [-150, 0, 30, 170])
    def test_bending_forward_leaves_it(self, bend_deg: float, heading_deg: float) -> None:
        """The yaw of roll-pitch-yaw jumps by 180° when the bend passes 90°."""
        q = rotations.multiply(turn(Z, heading_deg), turn(Y, bend_deg))
        assert np.degrees(rotations.yaw(q)) == pytest.approx(heading_deg, abs=1e-10)

    def test_upside_down_has_none(self) -> None:
        assert rotations.yaw([[0, 1, 0, 0], [-0.0, 0.6, 0.8, 0.0], [0.0, 0.0, 1.0, -0.0]]).tolist() == [0, 0, 0]


class TestShortestArc:
    @given(directions, directions)
    def test_takes_start_to_end_by_the_smallest_angle(self, start: Array, end: Array) -> None:
        q = rotations.shortest_arc(start, end)
        assert rotations.vector_angle(rotations.rotate(q, start), end) < 1e-14
        assert rotations.angle(q, [1, 0, 0, 0]) == pytest.approx(rotations.vector_angle(start, end), abs=1e-14)

    @pytest.mark.parametrize("short_of_opposite", [0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3])
    @pytest.mark.parametrize("start", [X, -X, Y, Z, [1, 2, 3], [0.9, 0.1, 0]], ids=str)
    def test_opposite_and_nearly_opposite_directions(self, start: Array, short_of_opposite: float) -> None:
        across = np.cross(start, [0.3, -0.5, 0.7])
        end = rotations.rotate(rotations.exp((np.pi - short_of_opposite) * across / np.linalg.norm(across)), start)
        q = rotations.shortest_arc(start, end)
        assert rotations.vector_angle(rotations.rotate(q, start), end) < 1e-14
        assert np.linalg.norm(q) == pytest.approx(1, abs=1e-15)

    def test_batches_against_one_direction(self) -> None:
        ends = np.random.default_rng(6).normal(size=(40, 3))
        q = rotations.shortest_arc(-Y, ends)
        assert q.shape == (40, 4)
        assert rotations.vector_angle(rotations.rotate(q, -Y), ends).max() < 1e-14


class TestMean:
    def test_is_scipys_mean_whatever_the_signs(self) -> None:
        rng = np.random.default_rng(7)
        for spread in (0.0, 0.02, 0.5):
            turns = Rotation.random(random_state=rng) * Rotation.from_rotvec(rng.normal(0, spread, (50, 3)))
            signed = np.roll(turns.as_quat(), 1, axis=-1) * rng.choice([-1.0, 1.0], (50, 1))
            found = rotations.mean(signed)
            assert found[0] >= 0
            assert (scipy(found) * turns.mean().inv()).magnitude() < 1e-12

    def test_of_two_is_the_middle(self) -> None:
        assert rotations.mean([turn(Z, 10), turn(Z, 50)]) == pytest.approx(turn(Z, 30), abs=1e-15)


@pytest.mark.parametrize("shape", [(), (7,), (3, 2)])
def test_about_z_is_scipys_and_has_the_yaw_that_it_was_given(shape: tuple[int, ...]) -> None:
    angles = np.random.default_rng(5).uniform(-3, 3, shape)
    found = rotations.about_z(angles)
    assert found.shape == (*shape, 4)
    assert rotations.yaw(found) == pytest.approx(angles, abs=1e-14)
    expected = Rotation.from_euler("z", np.ravel(angles)[:, None]).as_matrix().reshape(*shape, 3, 3)
    np.testing.assert_allclose(rotations.to_matrix(found), expected, atol=1e-15)


def test_about_z_goes_on_through_full_turns() -> None:
    angles = np.linspace(0, 20, 500)
    assert (np.einsum("ti,ti->t", rotations.about_z(angles)[1:], rotations.about_z(angles)[:-1]) > 0).all()
