"""Pictures of a MuJoCo model in given postures, drawn without a screen: for the snapshots of a report and for videos.

Which OpenGL draws them (EGL, OSMesa, GLFW) is decided by MUJOCO_GL when mujoco is first imported, not here.
"""

from __future__ import annotations

import copy
import os
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import UsageError
from retarget.core.replay.spec import SEEN_GROUP, SOLID_GROUP
from retarget.core.stick_figure import Bones
from retarget.core.types import Array

Image = NDArray[np.uint8]

AZIMUTH_DEG, ELEVATION_DEG = 125.0, -8.0
"""Where the viewer looks to: from in front of someone who faces +X, from their right, a little down."""
BACKDROP, PERSON = (0.94, 0.95, 0.96, 1.0), (0.17, 0.18, 0.21, 1.0)
PERSON_RADIUS_M = 0.025
GAP_M = 0.25
MARGIN = 1.06
FRAMED_POSTURES = 24
"""Most postures looked at to choose the distance of the camera."""


class Painter:
    """Draws one model, and a stick figure of a person to its left where one is given; to be used as a context manager.

    mj: the MuJoCo model, copied. postures: (K, nq) qpos that all have to fit into the picture, the camera moving along with the base.
    person: points (K, P, 3) m, world, and bones (B, 2), at the same instants as `postures`; not drawn where no point is known.
    samples: per pixel, against jagged edges; 0 is fastest.

    Raises `UsageError` where no OpenGL can draw without a screen.
    """

    def __init__(
        self,
        mj: Any,
        postures: Array,
        *,
        width: int,
        height: int,
        person: tuple[Array, Bones] | None = None,
        samples: int = 4,
    ) -> None:
        self._mj = copy.copy(mj)
        self._mj.vis.global_.offwidth, self._mj.vis.global_.offheight = width, height
        self._mj.vis.quality.offsamples, self._mj.vis.quality.shadowsize = samples, 0
        self._mj.vis.headlight.ambient[:], self._mj.vis.headlight.diffuse[:] = 0.4, 0.4
        self._mj.vis.headlight.specular[:] = 0.1
        self._data = mujoco.MjData(self._mj)
        self._option = mujoco.MjvOption()
        # Where there are shapes that are only to be seen, those; else the ones that collide.
        self._option.geomgroup[SOLID_GROUP] = not (self._mj.geom_group == SEEN_GROUP).any()
        chosen = np.unique(np.linspace(0, len(postures) - 1, FRAMED_POSTURES).round().astype(int))
        low, high = self._box(postures[chosen])
        self._person_shift, self._bones = np.zeros(3), None
        if person is not None and np.isfinite(person[0][chosen]).all(axis=-1).any():
            low, high = self._place(person[0][chosen], low, high)
            self._bones = person[1]
        self._camera = mujoco.MjvCamera()
        self._camera.azimuth, self._camera.elevation = AZIMUTH_DEG, ELEVATION_DEG
        self._centre = (low + high) / 2
        half_width, half_height = MARGIN * (high - low)[1:] / 2
        slope = np.tan(np.radians(self._mj.vis.global_.fovy) / 2)
        near = (high - low)[0] / 2  # what stands nearer to the camera than the centre looks larger
        self._camera.distance = float(near + max(half_height, half_width * height / width) / slope)
        try:
            self._renderer = mujoco.Renderer(self._mj, height, width)
        except Exception as error:  # each OpenGL binding has its own kinds
            where = os.environ.get("MUJOCO_GL") or "the default"
            raise UsageError(
                f"no picture can be drawn with MUJOCO_GL={where} ({_one_line(error)}); expected egl (Mesa's libEGL) or osmesa"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._renderer.close()

    def draw(self, posture: Array, person: Array | None = None) -> Image:
        """The picture (height, width, 3) of the model at qpos `posture` (nq,), beside it the person's points (P, 3) m."""
        self._data.qpos[:] = posture
        mujoco.mj_kinematics(self._mj, self._data)
        mujoco.mj_comPos(self._mj, self._data)
        mujoco.mj_camlight(self._mj, self._data)
        base = self._base()
        self._camera.lookat[:] = base + _SCREEN.T @ self._centre
        self._renderer.update_scene(self._data, self._camera, self._option)
        self._add_backdrop()
        if person is not None and self._bones is not None:
            self._add_person(self._seen_person(person) @ _SCREEN + base)
        return np.asarray(self._renderer.render()).copy()

    def _base(self) -> Array:
        """(3,) m: where the root body stands, on the ground plane of the world."""
        return np.array([*self._data.xpos[1, :2], 0.0])

    def _box(self, postures: Array) -> tuple[Array, Array]:
        """Corners of a box about the model in all `postures`, in screen axes (toward, right, up) about the base."""
        drawn = np.flatnonzero((self._mj.geom_bodyid > 0) & (self._option.geomgroup[self._mj.geom_group] > 0))
        if not len(drawn):
            return np.full(3, -0.5), np.full(3, 0.5)
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        boxes = self._mj.geom_aabb[drawn]
        corners = boxes[:, None, :3] + signs * boxes[:, None, 3:]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for posture in postures:
            self._data.qpos[:] = posture
            mujoco.mj_kinematics(self._mj, self._data)
            turns = self._data.geom_xmat[drawn].reshape(-1, 3, 3)
            points = self._data.geom_xpos[drawn][:, None] + np.einsum("gij,gkj->gki", turns, corners)
            seen = (points.reshape(-1, 3) - self._base()) @ _SCREEN.T
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
        return low, high

    def _place(self, points: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Choose where the person stands, left of the robot and on the same height; the box about both."""
        seen = np.concatenate([_centred(frame) @ _SCREEN.T for frame in points])
        seen = seen[np.isfinite(seen).all(axis=1)]
        self._person_shift = np.array([0.0, low[1] - GAP_M - seen[:, 1].max(), low[2] - seen[:, 2].min()])
        placed = seen + self._person_shift
        return np.minimum(low, placed.min(axis=0)), np.maximum(high, placed.max(axis=0))

    def _seen_person(self, points: Array) -> Array:
        return _centred(points) @ _SCREEN.T + self._person_shift

    def _add_backdrop(self) -> None:
        scene = self._renderer.scene
        depth = 0.8 * self._mj.vis.map.zfar * self._mj.stat.extent
        camera = scene.camera[0]
        forward, up = np.array(camera.forward), np.array(camera.up)
        turn = np.stack([np.cross(up, forward), up, -forward], axis=1)
        geom = self._new_geom()
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_BOX,
            np.array([2 * depth, 2 * depth, 0.01]),
            np.array(camera.pos) + depth * forward,
            turn.flatten(),
            np.array(BACKDROP, np.float32),
        )
        geom.emission, geom.specular = 1.0, 0.0
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR

    def _add_person(self, points: Array) -> None:
        for bone in self._bones if self._bones is not None else ():
            ends = points[bone]
            if not np.isfinite(ends).all():
                continue
            geom = self._new_geom()
            mujoco.mjv_initGeom(
                geom,
                mujoco.mjtGeom.mjGEOM_CAPSULE,
                np.zeros(3),
                np.zeros(3),
                np.eye(3).flatten(),
                np.array(PERSON, np.float32),
            )
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, PERSON_RADIUS_M, ends[0], ends[1])

    def _new_geom(self) -> Any:
        scene = self._renderer.scene
        scene.ngeom += 1
        return scene.geoms[scene.ngeom - 1]


def show(mj: Any, time: Array, postures: Array) -> None:
    """MuJoCo's own viewer on a screen, replaying postures (K, nq) at their times (K,) s again and again until it is closed."""
    import time as clock

    import mujoco.viewer

    data = mujoco.MjData(mj)
    data.qpos[:] = postures[0]
    mujoco.mj_forward(mj, data)
    with mujoco.viewer.launch_passive(mj, data) as viewer:
        started = clock.monotonic()
        length = max(float(time[-1] - time[0]), 1e-3)
        while viewer.is_running():
            now = time[0] + (clock.monotonic() - started) % length
            with viewer.lock():
                data.qpos[:] = postures[min(int(np.searchsorted(time, now)), len(time) - 1)]
                data.time = float(now)
                mujoco.mj_forward(mj, data)
            viewer.sync()
            clock.sleep(1 / 60)


def _screen() -> Array:
    """(3, 3): world → (toward the viewer, right, up) for someone who looks level."""
    azimuth = np.radians(AZIMUTH_DEG)
    return np.array(
        [[-np.cos(azimuth), -np.sin(azimuth), 0.0], [np.sin(azimuth), -np.cos(azimuth), 0.0], [0.0, 0.0, 1.0]]
    )


_SCREEN = _screen()


def _centred(points: Array) -> Array:
    """Points (P, 3) with their horizontal middle at the origin."""
    middle = points[np.isfinite(points).all(axis=1), :2].mean(axis=0)
    return np.asarray(points - np.append(middle, 0.0))


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
