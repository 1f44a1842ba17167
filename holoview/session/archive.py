"""A session as a folder: session.json names objects/*.safetensors by their content, so that steps share patterns.

Objects are written first, then session.json in one rename, each to the disk: whenever the program dies, or a driver
takes the machine with it, the folder holds a whole session.
Nothing is pickled; what can't be read back is left out and told.
"""

from __future__ import annotations

import hashlib
import json
import weakref
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.model import preset
from holoview.model.system import System
from holoview.session.document import Document, as_readonly_drive
from holoview.session.history import HistoryStep
from holoview.session.target_spec import TargetSpec
from holoview.session.view_settings import ComparisonSide, ViewSettings
from holoview.targets.picture import Picture
from holoview.targets.target import Placement
from holoview.util.errors import UserError
from holoview.util.files import atomic_write, fsync
from holoview.util.safetensors_file import TensorFormat

FORMAT, VERSION = "holoview-session", 1
_FILE = "session.json"
_ARRAY = TensorFormat("holoview-object", "1", "patterns or a picture of a saved session", ("array",), ())


@dataclass(frozen=True, eq=False)
class SessionData:
    """All of a session that is saved; `unfinished` is what a running optimisation has found."""

    steps: tuple[HistoryStep, ...]
    position: int
    snapshots: Mapping[str, Document]
    unfinished: Document | None = None

    @property
    def present(self) -> Document:
        """The current state."""
        return self.steps[self.position].document


class SessionArchive:
    """Writes documents into a folder, again and again; what hasn't changed isn't written again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._objects = folder / "objects"
        self._names: dict[int, tuple[weakref.ref[Any], str]] = {}
        self._systems: dict[System, str] = {}

    def write(self, document: SessionData, metadata: Mapping[str, Any]) -> None:
        """Writes the document; `facts` go into session.json beside it. Raises UserError when the disk refuses."""
        self._objects.mkdir(parents=True, exist_ok=True)
        systems: dict[str, str] = {}
        targets: dict[str, Any] = {}

        def written(state: Document) -> dict[str, Any]:
            return self._document_table(state, systems, targets)

        steps = [{"label": s.label, "when": s.when, **written(s.document)} for s in document.steps]
        table = {
            "format": FORMAT,
            "version": VERSION,
            **metadata,
            "position": document.position,
            "steps": steps,
            "snapshots": {name: written(state) for name, state in document.snapshots.items()},
            "unfinished": None if document.unfinished is None else written(document.unfinished),
            "systems": systems,
            "targets": targets,
        }
        text = json.dumps(table)
        with atomic_write(self.folder / _FILE) as temporary:
            temporary.write_text(text, encoding="utf-8")
            fsync(temporary)
        fsync(self.folder)
        for path in self._objects.glob("*.safetensors"):
            if path.stem not in text:
                path.unlink(missing_ok=True)

    def _document_table(self, state: Document, systems: dict[str, str], targets: dict[str, Any]) -> dict[str, Any]:
        if state.system not in self._systems:
            self._systems[state.system] = preset.dumps(state.system)
        toml = self._systems[state.system]
        key = hashlib.sha256(toml.encode()).hexdigest()[:16]
        systems[key] = toml
        wanted = None
        if state.target_spec is not None:
            wanted = str(id(state.target_spec))
            targets.setdefault(wanted, self._target_table(state.target_spec))
        return {
            "system": key,
            "drive": self._store_array(state.drive),
            "wanted": wanted,
            "look": _look_table(state.view_settings),
            "origin": state.origin,
            "path": None if state.path is None else str(state.path),
        }

    def _target_table(self, wanted: TargetSpec) -> dict[str, Any]:
        table = {key: getattr(wanted, key) for key in ("title", "brightness", "saturation", "space")}
        placement = asdict(wanted.placement)
        table["placement"] = placement | {"depth": None if placement["depth"] is None else str(placement["depth"])}
        if isinstance(wanted.source, Path):
            return table | {"stack": str(wanted.source)}
        return table | {"picture": self._store_array(wanted.source.rgb), "source": wanted.source.source}

    def _store_array(self, array: NDArray[np.float32]) -> str:
        """The name of an array's file, written if it isn't there yet."""
        known = self._names.get(id(array))
        if known is None or known[0]() is not array:
            digest = hashlib.sha256(repr(array.shape).encode() + np.ascontiguousarray(array).data).hexdigest()[:32]
            known = (weakref.ref(array), digest)
            self._names[id(array)] = known
        path = self._objects / f"{known[1]}.safetensors"
        if not path.is_file():
            _ARRAY.write(path, {"array": array}, {})
            fsync(path)
            fsync(self._objects)
        return known[1]


def read_metadata(folder: Path) -> dict[str, Any]:
    """session.json of a folder. Raises UserError when it is missing, damaged, or of another version."""
    path = folder / _FILE
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        if (table["format"], table["version"]) != (FORMAT, VERSION):
            raise UserError(str(path), f"version {table['version']}", expected=f"{FORMAT}, version {VERSION}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(str(path), f"can't be read: {error}", expected="a saved session") from error
    return dict(table)


def read_session(folder: Path) -> tuple[SessionData, list[str]]:
    """The document of a folder, and in words what of it couldn't be read. Raises UserError when nothing could be."""
    table = read_metadata(folder)
    reader = _Reader(folder, table)
    steps: list[HistoryStep] = []
    position = 0
    for index, entry in enumerate(table["steps"]):
        state = reader.document(entry, f'step "{entry["label"]}"')
        if state is not None:
            steps.append(HistoryStep(entry["label"], state, entry["when"]))
        if index <= table["position"]:
            position = max(len(steps) - 1, 0)
    if not steps:
        raise UserError(str(folder), "no step of it can be read", expected="a saved session")
    snapshots = {name: reader.document(entry, f'snapshot "{name}"') for name, entry in table["snapshots"].items()}
    unfinished = (
        None if table["unfinished"] is None else reader.document(table["unfinished"], "unfinished optimisation")
    )
    kept = {name: state for name, state in snapshots.items() if state is not None}
    return SessionData(tuple(steps), position, kept, unfinished), reader.unreadable


class _Reader:
    """Reads states; systems, patterns and targets once each, so that steps share them again."""

    def __init__(self, folder: Path, table: Mapping[str, Any]) -> None:
        self._folder, self._table = folder, table
        self._arrays: dict[str, NDArray[np.float32]] = {}
        self._systems: dict[str, System] = {}
        self._targets: dict[str, TargetSpec] = {}
        self.unreadable: list[str] = []

    def document(self, entry: Mapping[str, Any], what: str) -> Document | None:
        try:
            return Document(
                self._system(entry["system"]),
                self._array(entry["drive"]),
                _look(entry["look"]),
                None if entry["wanted"] is None else self._target(entry["wanted"]),
                entry["origin"],
                None if entry["path"] is None else Path(entry["path"]),
            )
        except (UserError, KeyError, TypeError, ValueError) as error:
            self.unreadable.append(f"{what}: {error}")
            return None

    def _system(self, key: str) -> System:
        if key not in self._systems:
            self._systems[key] = preset.loads(self._table["systems"][key], "saved system")
        return self._systems[key]

    def _array(self, name: str) -> NDArray[np.float32]:
        if name not in self._arrays:
            tensors, _ = _ARRAY.read(self._folder / "objects" / f"{name}.safetensors")
            self._arrays[name] = as_readonly_drive(tensors["array"])
        return self._arrays[name]

    def _target(self, key: str) -> TargetSpec:
        if key not in self._targets:
            table = self._table["targets"][key]
            plain = {name: table[name] for name in ("title", "brightness", "saturation", "space")}
            source: Picture | Path
            source = (
                Path(table["stack"]) if "stack" in table else Picture(self._array(table["picture"]), table["source"])
            )
            self._targets[key] = TargetSpec(source, placement=Placement(**table["placement"]), **plain)
        return self._targets[key]


# --- the look -------------------------------------------------------------------------------------------------------


def _look_table(look: ViewSettings) -> dict[str, Any]:
    table = asdict(look)
    return table | {"muted": sorted(look.muted)}


def _look(table: Mapping[str, Any]) -> ViewSettings:
    """The look of a table; a field that isn't there has its default."""
    values: dict[str, Any] = {}
    for field in fields(ViewSettings):
        if field.name in table:
            value = table[field.name]
            values[field.name] = tuple(value) if isinstance(value, list) else value
    values |= {key: ComparisonSide(**values[key]) for key in ("a", "b") if key in values}
    values["muted"] = frozenset(values.get("muted", ()))
    return ViewSettings(**values)
