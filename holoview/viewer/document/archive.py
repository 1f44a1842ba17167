"""Reads and writes a session as a folder of JSON and safetensors files.

`session.json` holds the history; patterns and pictures are in `objects/*.safetensors`, named by a hash of their
content, so that steps of the history share them. Objects are written before `session.json`, which is replaced by
renaming, and each is flushed to the disk (fsync): the folder holds a complete session even after a crash of the
machine. A value that can't be read back is left out and reported.

In order: view settings as values for JSON and back; the archive; its objects.
"""

from __future__ import annotations

import hashlib
import json
import weakref
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.reading import Recording
from holoview.holograms.load_field import Recorded
from holoview.holograms.targets.framing import Framing
from holoview.holograms.targets.picture import Picture
from holoview.holograms.targets.target import Placement
from holoview.light.model import preset
from holoview.light.model.elements import ElementsField
from holoview.light.model.focus import PupilPath
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import read_text
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import ArraySchema, parse_json_table, record_from_table, typed_value
from holoview.viewer.document.document import Document, HistoryStep, Looks, LookStep, Parked, as_readonly_drive
from holoview.viewer.document.editing_session import OptimisationChoices
from holoview.viewer.document.optimisation_job import UnfinishedOptimisation, read_rest
from holoview.viewer.document.target_builder import TargetSpec, example_target
from holoview.viewer.render.scene import Drive, ElementPatterns
from holoview.viewer.render.view_settings import ViewSettings


def view_settings_table(view: ViewSettings) -> dict[str, Any]:
    """The fields as values that JSON can hold, without the path of the pupil."""
    return asdict(replace(view, pupil_path=None)) | {"muted": sorted(view.muted)}


def view_settings_from_table(table: Mapping[str, Any], pupil_path: PupilPath | None = None) -> ViewSettings:
    """The view settings of a table; a missing field gets its default, an unknown field is left out.

    Raises UserError for a value of a wrong type or out of range.
    """
    return record_from_table(ViewSettings, table, "view settings: ", skips_unknown=True, pupil_path=pupil_path)


# --- the archive -----------------------------------------------------------------------------------------------------

FORMAT, VERSION = "holoview-session", 1
SESSION_FILE = "session.json"
_WHAT, _MOST_BYTES = "a saved session", 1 << 28  # of session.json: a history of a thousand steps has about a million
_TABLE_TYPES = {"steps": list, "position": int, "snapshots": dict, "systems": dict, "targets": dict}
_DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)
"""Exceptions that a damaged file raises when it is read; UserError is a ValueError."""
_ARRAY = TensorFormat(
    "holoview-object", "1", "patterns or a picture of a saved session", (ArraySchema("array", ("float32",), None),), ()
)


@dataclass(frozen=True, eq=False)
class SessionData:
    """The data of a session that are saved.

    steps: of the history: steps up to the present, and undone steps; position: index of the present step. snapshots: by
    name. unfinished: an optimisation that was running. choices: for the next one. looks: those before the present one,
    and those that were gone back from.
    """

    steps: tuple[HistoryStep, ...]
    position: int
    snapshots: Mapping[str, Document]
    unfinished: UnfinishedOptimisation | None = None
    choices: OptimisationChoices = field(default_factory=OptimisationChoices)
    looks: Looks = ((), ())

    @property
    def present(self) -> Document:
        """The document at the present step."""
        return self.steps[self.position].document


class SessionArchive:
    """Writes a session into a folder repeatedly; objects that are already there aren't written again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._objects = folder / "objects"
        self._names: dict[int, tuple[weakref.ref[Any], str]] = {}
        self._systems: dict[System, str] = {}

    def write(self, data: SessionData, metadata: Mapping[str, Any]) -> None:
        """Writes the data, with `metadata` in session.json. Raises WriteError when the disk can't be written.

        Objects that no step refers to any more are deleted.
        """
        make_folder(self._objects)
        systems: dict[str, str] = {}
        targets: dict[str, Any] = {}
        paths: dict[str, Any] = {}
        recordings: dict[str, Any] = {}

        def table_of(document: Document) -> dict[str, Any]:
            table = self._document_table(document, systems, targets)
            table["recorded"] = self._recorded_table(document.recorded, recordings)
            return table | {"look": _view_table(document.view_settings, paths)}

        steps = [
            {"label": step.label, "when": step.when, "sets_look": step.sets_look, **table_of(step.document)}
            for step in data.steps
        ]
        table = {
            "format": FORMAT,
            "version": VERSION,
            **metadata,
            "position": data.position,
            "steps": steps,
            "snapshots": {name: table_of(document) for name, document in data.snapshots.items()},
            "unfinished": None
            if (unfinished := data.unfinished) is None
            else table_of(unfinished.best) | {"rest": unfinished.rest_table()},
            "choices": asdict(data.choices),
            "looks": [
                [{"label": step.label, "when": step.when, "look": _view_table(step.look, paths)} for step in some]
                for some in data.looks
            ],
            "systems": systems,
            "targets": targets,
            "pupil_paths": paths,
            "recordings": recordings,
        }
        content = json.dumps(table)
        write_file(self.folder / SESSION_FILE, content)
        for path in self._objects.glob("*.safetensors"):
            if path.stem not in content:
                with suppress(OSError):  # on a disk that is read-only by now
                    path.unlink(missing_ok=True)
        kept = set(systems.values())
        self._systems = {system: toml for system, toml in self._systems.items() if toml in kept}
        self._names = {key: entry for key, entry in self._names.items() if entry[0]() is not None}

    def _document_table(self, document: Document, systems: dict[str, str], targets: dict[str, Any]) -> dict[str, Any]:
        """The JSON of a document but its view; system and target are added to the tables that all documents share."""
        if document.system not in self._systems:
            self._systems[document.system] = preset.dumps(document.system, self.folder)
        toml = self._systems[document.system]
        system_key = hashlib.sha256(toml.encode()).hexdigest()[:16]
        systems[system_key] = toml
        target_key = None
        if document.target_spec is not None:
            target_key = str(id(document.target_spec))
            targets.setdefault(target_key, self._target_table(document.target_spec))
        return {
            "system": system_key,
            "drive": self._store_drive(document.drive),
            "parked": [self._parked_table(parked) for parked in document.parked],
            "wanted": target_key,
            "origin": document.origin,
            "path": None if document.path is None else str(document.path),
        }

    def _recorded_table(self, recorded: Recorded | None, recordings: dict[str, Any]) -> dict[str, Any] | None:
        """The JSON of a recording; what its document shares with others is added to the table of recordings."""
        if recorded is None:
            return None
        recording = recorded.recording
        key = str(id(recording))
        if key not in recordings:
            table = {entry.name: getattr(recording, entry.name) for entry in fields(recording)}
            pictures, lasers = self._store_array(recording.pictures), recording.wavelengths_m.tolist()
            orders = [asdict(order) for order in recording.orders]
            recordings[key] = table | {"pictures": pictures, "wavelengths_m": lasers, "orders": orders}
        return {"recording": key, "is_moved": recorded.is_moved}

    def _target_table(self, target_spec: TargetSpec) -> dict[str, Any]:
        table: dict[str, Any] = {"title": target_spec.title, "is_example": target_spec.is_example} | target_spec.light
        if target_spec.is_example:  # its files are shipped, and lie elsewhere in another installation
            return table | {"framing": asdict(target_spec.placement.framing)}
        placement = asdict(target_spec.placement)
        table["placement"] = placement | {"depth": None if placement["depth"] is None else str(placement["depth"])}
        if isinstance(target_spec.source, Path):
            return table | {"stack": str(target_spec.source)}
        return table | {"picture": self._store_array(target_spec.source.rgb), "source": target_spec.source.source}

    def _parked_table(self, parked: Parked) -> dict[str, Any]:
        """The JSON of an element that is switched off."""
        drive = None if parked.drive is None else self._store_drive({parked.name: parked.drive})
        elements = ElementsField().to_toml(parked.elements)
        own = {"name": parked.name, "behind": parked.behind, "shift_m": parked.shift_m}
        return {**own, "elements": elements, "drive": drive}

    def _store_drive(self, drive: Drive) -> str | dict[str, list[Any]]:
        """Stores a drive; of a chain the name of each array, and whether its numbers are complex."""
        if not isinstance(drive, Mapping):
            return self._store_array(drive)
        return {name: [self._store_array(array), bool(np.iscomplexobj(array))] for name, array in drive.items()}

    def _store_array(self, array: NDArray[Any]) -> str:
        """Writes an array to a file named by its hash, unless that exists; returns the name without suffix."""
        entry = self._names.get(id(array))
        if entry is None or entry[0]() is not array:
            digest = hashlib.sha256(repr(array.shape).encode() + np.ascontiguousarray(array).data).hexdigest()[:32]
            entry = (weakref.ref(array), digest)
            self._names[id(array)] = entry
        path = self._objects / f"{entry[1]}.safetensors"
        if not path.is_file():
            _ARRAY.write(path, {"array": _as_real(array)}, {})
        return entry[1]


def _as_real(drive: NDArray[Any]) -> NDArray[np.float32]:
    """A drive as it is stored: complex values as pairs of real numbers, without a copy."""
    return drive[..., None].view(np.float32) if np.iscomplexobj(drive) else drive


def _view_table(view: ViewSettings, paths: dict[str, Any]) -> dict[str, Any]:
    """The JSON of view settings; their path of the pupil is added to the table that all share."""
    if view.pupil_path is None:
        return view_settings_table(view)
    key = str(id(view.pupil_path))
    paths.setdefault(key, asdict(view.pupil_path))
    return view_settings_table(view) | {"pupil_path": key}


def read_metadata(folder: Path) -> dict[str, Any]:
    """The content of a folder's session.json. Raises UserError when it is missing, damaged, or of another version."""
    path = folder / SESSION_FILE
    table = parse_json_table(read_text(path, _WHAT, most=_MOST_BYTES), str(path), _WHAT, finite=True)
    if (table.get("format"), table.get("version")) != (FORMAT, VERSION):
        raise UserError(str(path), f"version {table.get('version')}", expected=f"{FORMAT}, version {VERSION}")
    for name, kind in _TABLE_TYPES.items():
        if not isinstance(table.get(name), kind):
            raise UserError(f"{path}: {name}", f"{type(table.get(name)).__name__}", expected=f"a {kind.__name__}")
    return table


def is_of_other_version(folder: Path) -> bool:
    """Whether the session in a folder is whole, but written by another version of holoview."""
    path = folder / SESSION_FILE
    try:
        table = parse_json_table(read_text(path, _WHAT, most=_MOST_BYTES), str(path), _WHAT)
        return bool(table["format"] == FORMAT and isinstance(table["version"], int) and table["version"] != VERSION)
    except _DAMAGE:
        return False


def read_session(folder: Path) -> tuple[SessionData, list[str]]:
    """The session in a folder, and a sentence for each part that couldn't be read.

    Raises UserError when session.json or every step of the history is unreadable.
    """
    table = read_metadata(folder)
    try:
        return _read_table(folder, table)
    except _DAMAGE as error:
        if isinstance(error, UserError):
            raise
        raise UserError(str(folder), f"is damaged: {_reason(error)}", expected="a saved session") from error


def _read_table(folder: Path, table: Mapping[str, Any]) -> tuple[SessionData, list[str]]:
    reader = _Reader(folder, table)
    steps: list[HistoryStep] = []
    position, present = 0, typed_value(table["position"], int, "position")
    for number, entry in enumerate(table["steps"]):
        label = typed_value(entry["label"], str, "label")
        document = reader.document(entry, f'step "{label}"')
        if document is not None:
            when = typed_value(entry["when"], float, "when")
            sets_look = typed_value(entry.get("sets_look", True), bool, "sets_look")
            steps.append(HistoryStep(label, document, when, sets_look=sets_look))
        if number <= present:
            position = max(len(steps) - 1, 0)
    if not steps:
        raise UserError(str(folder), "no step of it can be read", expected="a saved session")
    snapshots = {name: reader.document(entry, f'snapshot "{name}"') for name, entry in table["snapshots"].items()}
    unfinished = reader.unfinished(table.get("unfinished"))
    readable = {name: document for name, document in snapshots.items() if document is not None}
    choices = reader.choices(table.get("choices", {}))
    looks = reader.looks(table.get("looks", [[], []]))
    return SessionData(tuple(steps), position, readable, unfinished, choices, looks), reader.unreadable


def _reason(error: Exception) -> str:
    """The reason in words."""
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)


class _Reader:
    """Reads documents; each system, array and target is read once, so that steps share them again."""

    def __init__(self, folder: Path, table: Mapping[str, Any]) -> None:
        self._folder, self._table = folder, table
        self._arrays: dict[str, NDArray[np.float32]] = {}
        self._fields: dict[str, Drive] = {}
        self._systems: dict[str, System] = {}
        self._targets: dict[str, TargetSpec] = {}
        self._paths: dict[str, PupilPath] = {}
        self._recordings: dict[str, Recording] = {}
        self.unreadable: list[str] = []

    def document(self, entry: Mapping[str, Any], what: str) -> Document | None:
        """A document; None where it can't be read, which is then noted in `unreadable`."""
        try:
            system = self._system(entry["system"])
            return Document(
                system,
                self._drive(entry["drive"], is_field=system.is_field),
                self._view(entry["look"]),
                None if entry["wanted"] is None else self._target(entry["wanted"]),
                typed_value(entry["origin"], str, "origin"),
                None if entry["path"] is None else Path(typed_value(entry["path"], str, "path")),
                self._recorded(entry.get("recorded")),
                tuple(self._parked(parked) for parked in entry.get("parked", ())),
            )
        except _DAMAGE as error:
            self.unreadable.append(f"{what}: {_reason(error)}")
            return None

    def choices(self, table: Mapping[str, Any]) -> OptimisationChoices:
        """Choices for the next optimisation; the defaults where they can't be read, which is then noted."""
        try:
            return record_from_table(OptimisationChoices, table, skips_unknown=True)
        except _DAMAGE as error:
            self.unreadable.append(f"choices for the next optimisation: {_reason(error)}")
            return OptimisationChoices()

    def looks(self, table: Any) -> Looks:
        """The looks before and after the present one; none where they can't be read, which is then noted."""
        try:
            before, after = (tuple(self._look_step(entry) for entry in some) for some in table)
        except _DAMAGE as error:
            self.unreadable.append(f"earlier looks: {_reason(error)}")
            return (), ()
        return before, after

    def _look_step(self, entry: Mapping[str, Any]) -> LookStep:
        label, when = typed_value(entry["label"], str, "label"), typed_value(entry["when"], float, "when")
        return LookStep(label, self._view(entry["look"]), when)

    def unfinished(self, entry: Mapping[str, Any] | None) -> UnfinishedOptimisation | None:
        """An optimisation that was running; without the rest of the optimisation where that can't be read."""
        best = None if entry is None else self.document(entry, "unfinished optimisation")
        if entry is None or best is None:
            return None
        try:
            return UnfinishedOptimisation(best, read_rest(entry.get("rest")))
        except _DAMAGE as error:
            self.unreadable.append(f"unfinished optimisation: {_reason(error)}")
            return UnfinishedOptimisation(best)

    def _system(self, key: str) -> System:
        if key not in self._systems:
            self._systems[key] = preset.loads(self._table["systems"][key], "saved system", self._folder)
        return self._systems[key]

    def _parked(self, table: Mapping[str, Any]) -> Parked:
        name = typed_value(table["name"], str, "name")
        return Parked(
            name,
            ElementsField().parse(table["elements"], "parked"),
            typed_value(table["behind"], str, "behind"),
            typed_value(table["shift_m"], float, "shift_m"),
            None if table["drive"] is None else self._drive(table["drive"])[name],
        )

    def _drive(self, entry: Any, *, is_field: bool = False) -> Drive:
        """A drive; that of a chain is a table of names and whether the numbers are complex."""
        if not isinstance(entry, Mapping):
            return self._field(entry) if is_field else self._array(entry)
        read = {
            name: (self._field if is_complex else self._array)(array) for name, (array, is_complex) in entry.items()
        }
        return ElementPatterns(read)

    def _array(self, name: str) -> NDArray[np.float32]:
        if name not in self._arrays:
            if not (isinstance(name, str) and name.isalnum()):
                raise UserError("object", f"{name!r}", expected="a name of letters and digits")
            tensors, _ = _ARRAY.read(self._folder / "objects" / f"{name}.safetensors")
            self._arrays[name] = as_readonly_drive(tensors["array"])
        return self._arrays[name]

    def _field(self, name: str) -> Drive:
        """The values of a field, which are stored as pairs of real numbers; steps of the history share them."""
        if name not in self._fields:
            pairs = self._array(name)
            self._fields[name] = np.ascontiguousarray(pairs).view(np.complex64)[..., 0]
            self._fields[name].setflags(write=False)
        return self._fields[name]

    def _target(self, key: str) -> TargetSpec:
        if key not in self._targets:
            table = self._table["targets"][key]
            if table.get("is_example"):
                example, framing = example_target(), record_from_table(Framing, table.get("framing", {}))
                source, placement = example.source, replace(example.placement, framing=framing)
            else:
                source, placement = self._target_source(table), record_from_table(Placement, table["placement"])
            self._targets[key] = record_from_table(
                TargetSpec, table, "target: ", skips_unknown=True, source=source, placement=placement
            )
        return self._targets[key]

    def _recorded(self, table: Mapping[str, Any] | None) -> Recorded | None:
        if table is None:
            return None
        key = typed_value(table["recording"], str, "recording")
        if key not in self._recordings:
            entry = self._table["recordings"][key]
            steps = entry["steps"]
            own: dict[str, Any] = {"pictures": self._array(entry["pictures"]), "steps": steps}
            if steps not in ("equal", "unknown"):
                own["steps"] = typed_value(steps, tuple[float, ...], "steps")
            own["wavelengths_m"] = np.array(typed_value(entry["wavelengths_m"], tuple[float, ...], "wavelengths"))
            self._recordings[key] = record_from_table(Recording, entry, "recording: ", skips_unknown=True, **own)
        return record_from_table(Recorded, table, skips_unknown=True, recording=self._recordings[key])

    def _view(self, table: Mapping[str, Any]) -> ViewSettings:
        key = table.get("pupil_path")
        if key is not None and key not in self._paths:
            self._paths[key] = record_from_table(PupilPath, self._table["pupil_paths"][key], skips_unknown=True)
        return view_settings_from_table(table, None if key is None else self._paths[key])

    def _target_source(self, table: Mapping[str, Any]) -> Picture | Path:
        if "stack" in table:
            return Path(typed_value(table["stack"], str, "stack"))
        return Picture(self._array(table["picture"]), typed_value(table["source"], str, "source"))
