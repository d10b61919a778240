"""Where the mesh files are that a URDF names: `package://`, `file://`, relative and absolute."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from retarget.core.profile import RobotProfile
from retarget.core.robot_urdf import find_urdf

MISSING = "mesh not found"
OUTSIDE = "mesh outside the model's own folder"


@dataclass(frozen=True)
class MeshPaths:
    """folder: of the URDF, None for a robot that comes without files. root: nothing outside is read, unless a package of that name stands beside."""

    folder: Path | None
    root: Path | None

    @classmethod
    def of(cls, profile: RobotProfile) -> MeshPaths:
        """The root is the folder with `package.xml` around the URDF, else the one above the URDF's: `urdf/` and `meshes/` are siblings."""
        if profile.model.kind == "human":
            return cls(None, None)
        folder = find_urdf(profile).resolve().parent
        root = next(
            (around for around in (folder, *folder.parents) if (around / "package.xml").is_file()), folder.parent
        )
        return cls(folder, root)

    def resolve(self, name: str) -> tuple[Path | None, str]:
        """(the file `name` stands for, "") or (None, why there is none).

        `package://NAME/rest`: the nearest folder around the URDF that is called NAME or holds one of that name.
        """
        if self.folder is None or self.root is None:
            return None, MISSING
        scheme, separator, rest = name.partition("://")
        if separator and scheme in ("package", "model"):
            package, _, inside = unquote(rest).partition("/")
            root = self._package(package)
            candidates = [] if root is None else [(root, root / inside)]
        else:
            path = Path(unquote(rest) if separator else name)
            candidates = [(self.root, self.folder / path), (self.root, self.root / path)]
        problem = MISSING
        for root, candidate in candidates:
            resolved = candidate.resolve()
            if not resolved.is_relative_to(root):
                problem = OUTSIDE
            elif resolved.is_file():
                return resolved, ""
        return None, problem

    def _package(self, name: str) -> Path | None:
        if self.folder is None or not name or name in (".", ".."):
            return None
        for around in (self.folder, *self.folder.parents):
            if around.parent == around:
                break  # the file system's own folders are nobody's packages
            if around.name == name:
                return around
            if (around / name).is_dir():
                return (around / name).resolve()
        return None
