"""Linux's control groups, by which containers and batch systems limit what a process may take."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

MOUNT = Path("sys/fs/cgroup")
MEMBERSHIP = Path("proc/self/cgroup")


def group_folders(mount: Path, membership: Path, controller: str) -> Iterator[Path]:
    """The folders of this process's groups of a controller, versions 1 and 2, and of those that contain them.

    mount: where the groups are mounted. membership: the file that names them. controller: such as "memory". In a
    container, the folders above its own group aren't seen, and its own is the root of the mount.
    """
    for line in read_lines(membership):
        _, controllers, name = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = mount / controllers if (mount / controllers).is_dir() else mount / controller
        folder = top / name.lstrip("/")
        yield from (group for group in (folder, *folder.parents) if group == top or top in group.parents)


def read_lines(path: Path) -> list[str]:
    """The lines of a file of the kernel; none where it can't be read."""
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
