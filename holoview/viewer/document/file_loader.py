"""Opens files in a session: recognises each by its content, reads it, and reads it again when it is rewritten."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Event, Thread

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from holoview.holograms.fields.reading import ReadRequest
from holoview.holograms.files.image_reader import animation_count, file_format
from holoview.holograms.files.pictures import read_pattern
from holoview.holograms.files.pupil_path_file import is_pupil_path, load_pupil_path
from holoview.holograms.files.raster import require_picture_memory
from holoview.holograms.files.readers.registry import is_readable
from holoview.holograms.files.request import MOST_UNASKED
from holoview.holograms.hologram import load_hologram
from holoview.holograms.load_field import Recorded, is_field_file, open_hologram
from holoview.holograms.optimise.checkpoint import load_checkpoint
from holoview.holograms.targets.focal_stack import is_stack
from holoview.holograms.targets.picture import Picture, read_picture
from holoview.holograms.targets.target_source import depth_beside
from holoview.holograms.view import random_drive
from holoview.light.colour import srgb_decode
from holoview.light.model import preset
from holoview.light.model.focus import PupilPath
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.files import expand_home, opened_file, read_text
from holoview.util.progress import StepCallback
from holoview.util.safetensors_file import format_of
from holoview.util.tables import parse_toml
from holoview.viewer.document.document import middle_plane
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.example import has_example_target, is_example_bench, random_patterns_hint, show_example
from holoview.viewer.document.jobs import BackgroundJob, JobControl
from holoview.viewer.document.optimisation_job import running_optimisation, start_quick_optimisation
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.page.link import shown_by_link, split_link
from holoview.viewer.page.page import is_page, read_page
from holoview.viewer.render.scene import Drive
from holoview.viewer.render.view_settings import NOW, ComparisonSide, ViewSettings

# --- files ------------------------------------------------------------------------------------------------------------


_RETRY_FOR_S = 10.0
"""How long a watched file may stay unreadable, being half written, before an error is reported."""


class FileLoader:
    """Opens files into a session in the background, and reloads a displayed hologram file when it is rewritten.

    remember: called with the path of each file that was opened. quick: whether a quick optimisation starts for a new
    target, at first; later `optimises_new_targets` says so. animation: the file that was opened last, if it holds an
    animation of which nobody has said whether it is a film or its first picture. most_samples: as of `read_content`.
    """

    def __init__(
        self,
        session: EditingSession,
        *,
        remember: Callable[[Path], None] = lambda path: None,
        quick: bool = True,
        most_samples: int = MOST_UNASKED,
    ) -> None:
        self.optimises_new_targets, self._most_samples = quick, most_samples
        self._session, self._remember = session, remember
        self.animation: FileContent | None = None
        self._watcher: FileWatcher | None = None
        self._openings: list[BackgroundJob] = []
        self._rereading: BackgroundJob | None = None
        self._is_watching = True
        self._stop = session.add_listener(lambda change: self._update_watcher() if "drive" in change.kinds else None)
        self._update_watcher()

    def open(self, names: str | Path | Sequence[str | Path], request: ReadRequest | None = None) -> BackgroundJob:
        """Opens one or several files, or a preset by its name; errors become messages.

        Once it is shown, what was to be opened before it and is still being read is cancelled.

        request: the known properties of a field of another program; None where its content tells its kind.
        """
        work = partial(read_content, names, self._session.system, request, most_samples=self._most_samples)
        earlier = [job for job in self._openings if job.is_active]

        def show(content: FileContent) -> None:
            _cancel(earlier)
            self.apply(content)

        job = self._session.jobs.start(f"Open {_title(names)}", lambda control: work(progress=control.report), show)
        self._openings = [*earlier, job]
        return job

    def open_beside(self, names: str | Path | Sequence[str | Path]) -> BackgroundJob:
        """Opens holograms or benches beside the present one, which stays; errors become messages."""
        work = partial(read_content, names, self._session.system, None, most_samples=self._most_samples)

        def keep(content: FileContent) -> None:
            pinned = [self._pin(of) for of in (content, *content.others)]
            self._session.edit_view("Shown", shown=ComparisonSide("snapshot", pinned[0]), compare="off", page="image")

        title = f"Open {_title(names)} beside"
        return self._session.jobs.start(title, lambda control: work(progress=control.report), keep)

    @property
    def is_opening(self) -> bool:
        """Whether the files that were opened last are still being read."""
        return bool(self._openings) and self._openings[-1].is_active

    def open_field_as_target(self, path: Path) -> None:
        """Makes the light of a field, whose plane is that of the last modulator, the target. Raises UserError."""
        if not is_field_file(path):
            raise UserError(str(path), "isn't a complex field", expected="a file that `holoview info` calls a field")
        _cancel(self._openings)
        self.apply(FileContent("picture", path.name, target_spec=TargetSpec(path, path.name), path=path))

    def paste(self, picture: NDArray[np.uint8] | bytes) -> None:
        """Makes 8-bit sRGB pixels (y, x, 3 or 4), or the bytes of a picture file, the target. Raises UserError."""
        target_spec = target_from_image_bytes(picture) if isinstance(picture, bytes) else target_from_pixels(picture)
        _cancel(self._openings)
        self.apply(FileContent("picture", target_spec.title, target_spec=target_spec))

    def apply(self, content: FileContent) -> None:
        """Applies the content of a file as an edit of the session. Raises UserError when it doesn't fit."""
        session = self._session
        for note in content.notes:
            session.messages.post(f"{content.title}: {note}")
        self.animation = content if content.pictures > 1 else None
        if content.target_spec is not None:
            self._set_target(content.target_spec)
        elif content.pupil_path is not None:
            self._set_pupil_path(content.title, content.pupil_path)
        elif content.kind == "preset" and has_example_target(session) and is_example_bench(content.system):
            show_example(session)
        else:
            self._set_hologram(content)
        if content.path is not None:
            self._remember(content.path)

    def _set_hologram(self, content: FileContent) -> None:
        session = self._session
        system = content.system or session.system
        assert content.drive is not None
        is_preset = content.kind == "preset"
        random = ", random patterns" if is_preset else ""
        path = content.path if content.kind == "hologram" else None
        view_settings = session.view_settings if is_preset else session.document.view_settings_for_picture
        if content.plane_m is not None:
            view_settings = view_settings.with_(plane_m=content.plane_m)
        if content.region is not None:
            view_settings = view_settings.with_(region=content.region)
        target_spec = None if has_example_target(session) and not is_preset else session.target_spec
        if system.is_field != session.system.is_field:
            target_spec = None
        session.edit(
            f"Open {content.title}",
            system=system,
            drive=content.drive,
            target_spec=target_spec,
            view_settings=_clamp_plane(view_settings, system),
            origin=f"{content.kind} {content.title}{random}",
            path=path,
            recorded=content.recorded,
        )
        session.mark_saved()
        self._set_beside(content)
        session.fits_exposure = content.kind == "field"
        if is_preset and target_spec is not None and not system.is_chain:
            session.messages.post(random_patterns_hint(target_spec))

    def _set_beside(self, content: FileContent) -> None:
        """Pins the other holograms as snapshots, and shows the first of them beside the one that was opened."""
        session = self._session
        names = [self._pin(other) for other in content.others]
        if names:
            beside = ComparisonSide("snapshot", names[0])
            session.edit_view("Side by side", a=NOW, b=beside, compare="side-by-side", page="image")

    def _pin(self, content: FileContent) -> str:
        """Pins a hologram and returns its name. Raises UserError for anything else."""
        session = self._session
        if content.drive is None:
            raise UserError(
                content.title, f"is a {content.kind}", expected="a hologram or a bench", remedy="open it alone"
            )
        origin = f"{content.kind} {content.title}"
        document = replace(
            session.document,
            system=content.system or session.system,
            drive=content.drive,
            origin=origin,
            path=content.path,
            recorded=content.recorded,
        )
        return session.pin_beside(content.title, document)

    def _set_target(self, target_spec: TargetSpec) -> None:
        """Sets a new target; the patterns change only if a quick optimisation starts."""
        session = self._session
        view_settings = session.document.view_settings_for_picture
        session.edit(f"Target {target_spec.title}", target_spec=target_spec, view_settings=view_settings)
        if said := target_spec.framing_text(session.system):
            session.messages.post(f"{target_spec.title}: {said}; the panel Optimise can frame it otherwise")
        if self.animation is None:
            self._optimise_quickly()

    def take_first_picture(self) -> None:
        """Keeps the first picture of an animation as the target."""
        self.animation = None
        self._optimise_quickly()

    def _optimise_quickly(self) -> None:
        """Starts a quick optimisation for a new target, if that is wanted; of a chain, whose pixels can't be joined, it
        would take long."""
        session = self._session
        if session.system.is_field or running_optimisation(session) is not None:
            return
        if session.system.is_chain:
            session.messages.post("Ctrl+Enter makes patterns for this target")
        elif self.optimises_new_targets:
            start_quick_optimisation(session)

    def _set_pupil_path(self, title: str, path: PupilPath) -> None:
        """Sets the path of the pupil; a bench without an eye gets one."""
        session = self._session
        system = session.system if session.system.eye is not None else session.system.edit({"eye": {}})
        session.edit(f"Open {title}", system=system, view_settings=session.view_settings.with_(pupil_path=path))
        session.messages.post(f"{title}: a path of {path.duration_s:.3g} s; the panel Eye plays it")

    # --- watching ---------------------------------------------------------------------------------------------------

    @property
    def watched_path(self) -> Path | None:
        """The hologram file that is watched, if any."""
        return None if self._watcher is None else self._watcher.path

    def set_watching(self, on: bool) -> None:
        """Sets whether a displayed hologram file is reloaded when another program rewrites it."""
        self._is_watching = on
        self._update_watcher()

    def close(self) -> None:
        """Stops watching."""
        self._stop()
        self.set_watching(False)

    def _update_watcher(self) -> None:
        path = self._session.document.path if self._is_watching else None
        if path == self.watched_path:
            return
        if self._watcher is not None:
            self._watcher.close()
        self._watcher = None if path is None else FileWatcher(path, partial(self._reread, path))

    def _reread(self, path: Path) -> None:
        """Called on the watcher's thread when the file has changed."""
        self._session.call_on_owner(lambda: self._reload(path))

    def _reload(self, path: Path) -> None:
        if path != self.watched_path:
            return
        system = self._session.system
        work = partial(_read_with_retries, path=path, system=system)
        _cancel([self._rereading] if self._rereading else [])
        self._rereading = self._session.jobs.start(f"Read {path.name} again", work, self._show_again)

    def _show_again(self, content: FileContent) -> None:
        if content.path == self.watched_path and content.drive is not None:
            self._set_hologram(content)
            self._session.messages.post(f"{content.title} was rewritten: read again")


def _cancel(jobs: Iterable[BackgroundJob]) -> None:
    for job in jobs:
        if job.is_active:
            job.cancel()


def _read_with_retries(control: JobControl, path: Path, system: System) -> FileContent:
    """Reads a file, again and again while it may be half written. Raises UserError when it stays unreadable."""
    for _ in range(round(_RETRY_FOR_S / POLL_INTERVAL_S)):
        control.check()
        try:
            return read_content(path, system)
        except UserError as error:
            last_error = error
        control.sleep(POLL_INTERVAL_S)
    raise last_error


def _clamp_plane(view: ViewSettings, system: System) -> ViewSettings:
    """The view settings for another system: its median plane if the present plane is outside its range."""
    low, high = float(system.planes_m.min()), float(system.planes_m.max())
    return view if low <= view.plane_m <= high else view.with_(plane_m=middle_plane(system))


def _title(names: str | Path | Sequence[str | Path]) -> str:
    several = [names] if isinstance(names, str | Path) else list(names)
    return Path(several[0]).name if len(several) == 1 else f"{len(several)} files"


# --- Recognises a file by its content and reads its contribution to a document ---
#
# hologram, page     system and patterns                TOML         a system, with random patterns
# pattern PNGs       patterns for the present system    a name       the preset of that name
# picture, stack     the target                         CSV          the path of the pupil
# .npy, .mat, …      a field of another program


_EXPECTED = (
    "a preset, a hologram file or page, a field of another program, pattern PNGs, "
    "a picture (PNG, JPEG, WebP, AVIF, TIFF, OpenEXR), or a pupil path (CSV)"
)


@dataclass(frozen=True, eq=False)
class FileContent:
    """The content of a file: its kind, a title, the parts of a document, notes for the user.

    kind: "hologram", "page", "preset", "patterns", "picture", "stack", "pupil path" or "field".
    plane_m: the focal plane that it is to be shown at; None for that of the viewer.
    region: the measured region that it is to be shown with; None likewise.
    recorded: the recording that a field is cut out of. others: what is to be shown beside it. pictures: of an
    animation, the first of which is the target.
    """

    kind: str
    title: str
    system: System | None = None
    drive: Drive | None = None
    target_spec: TargetSpec | None = None
    pupil_path: PupilPath | None = None
    path: Path | None = None
    plane_m: float | None = None
    region: Region | None = None
    notes: tuple[str, ...] = field(default=())
    recorded: Recorded | None = None
    others: tuple[FileContent, ...] = ()
    pictures: int = 1


@dataclass(frozen=True)
class FilesToOpen:
    """Files that are opened together. names: theirs, or that of a preset. request: as `read_content` takes it."""

    names: Sequence[str] = ()
    request: ReadRequest | None = None


NO_FILES = FilesToOpen()


_BYTES_A_SAMPLE = 48  # of the padded grid of a field: complex64, twice as long along each axis, up to a size of the FFT


def most_samples_for(binding_bytes: int) -> int:
    """Samples a colour of the largest field that a device shows which binds buffers of so many bytes."""
    return min(MOST_UNASKED, binding_bytes // _BYTES_A_SAMPLE)


def read_content(
    names: str | Path | Sequence[str | Path],
    system: System,
    request: ReadRequest | None = None,
    progress: StepCallback | None = None,
    most_samples: int = MOST_UNASKED,
) -> FileContent:
    """Reads one or several files, a folder, or the preset of a name; patterns must fit `system`.

    request: the known properties of the files, as parts of a field of another program; None where they may be anything.
    progress: as of `open_hologram`. most_samples: of a field with more samples a colour the middle is read.

    Raises UserError for an unknown format, a damaged file, and patterns that don't fit.
    """
    names_list = [names] if isinstance(names, str | Path) else list(names)
    if not names_list:
        raise UserError("open", "nothing", expected=_EXPECTED)
    paths = [expand_home(name) for name in names_list]
    open_field = partial(_field, progress=progress, most_samples=most_samples)
    if request is not None:
        return open_field(paths, request)
    if len(paths) > 1 and all(map(_is_whole, paths)):
        first, *others = (read_content(path, system, None, progress, most_samples) for path in paths)
        return replace(first, others=tuple(others))
    if len(paths) > 1:
        return _patterns(paths, system)
    path = paths[0]
    if _names_preset(path):
        return _preset(preset.load(path.name), path.name, None)
    page, state = split_link(path)
    if is_page(page):
        return _page(page, state)
    if path.is_dir():
        return _folder(path, system)
    return _file(path, system, open_field)


def _names_preset(path: Path) -> bool:
    return str(path) in preset.names() and not path.exists()


def _is_whole(path: Path) -> bool:
    """Whether a file is a hologram or a bench, and no part of one."""
    return _names_preset(path) or path.suffix == ".toml" or format_of(path) in ("holoview-hologram", "holoview-field")


def _file(path: Path, system: System, open_field: Callable[[list[Path], ReadRequest], FileContent]) -> FileContent:
    if is_pupil_path(path):
        return FileContent("pupil path", path.name, pupil_path=load_pupil_path(path), path=path)
    kind = file_format(path)
    if kind == "PNG" and is_pattern_png(path, system):
        return _patterns([path], system)
    if kind in ("PNG", "JPEG", "WebP", "AVIF", "HEIC", "GIF", "TIFF", "OpenEXR", "HDR", "NPZ"):
        return _stack(path) if is_stack(path) else _picture(path)
    file_type = format_of(path)
    if file_type in ("holoview-hologram", "holoview-field"):
        hologram = load_hologram(path)
        return FileContent("hologram", path.name, hologram.system, hologram.drive, path=path)
    if file_type == "holoview-checkpoint":
        best = load_checkpoint(path).best()
        return FileContent("hologram", path.name, best.system, best.drive, path=path)
    if _is_toml(path):
        return _preset(preset.load(path if path.suffix == ".toml" else _refuse_toml_suffix(path)), path.stem, path)
    if is_readable(path):
        return open_field([path], ReadRequest())
    raise UserError(str(path), "isn't a file that can be opened", expected=_EXPECTED)


def _field(paths: list[Path], request: ReadRequest, progress: StepCallback | None, most_samples: int) -> FileContent:
    """A field of another program; the notes name the properties that are guessed."""
    opened = open_hologram(paths, replace(request, accept_guesses=True, most_samples=most_samples), progress)
    shown, title, path = opened.hologram, paths[0].name, paths[0]
    return FileContent(
        "field", title, shown.system, shown.drive, path=path, notes=opened.notes, recorded=opened.recorded
    )


def _page(path: Path, state: str) -> FileContent:
    """The first hologram of a page, with the state of a link to it."""
    (name, hologram), *others = read_page(path).items()
    shown = shown_by_link(hologram, state)
    notes = (f"{name}, the first of {1 + len(others)} holograms",) if others else ()
    bench, drive = shown.hologram.system, shown.hologram.drive
    return FileContent(
        "page", path.name, bench, drive, path=path, plane_m=shown.plane_m, region=shown.region, notes=notes
    )


def _refuse_toml_suffix(path: Path) -> Path:
    raise UserError(str(path), f'a bench in a file with the suffix "{path.suffix}"', remedy="rename it to .toml")


def _is_toml(path: Path) -> bool:
    if path.suffix == ".toml":
        return True
    try:
        return bool(parse_toml(read_text(path, "TOML"), str(path), "TOML"))
    except UserError:
        return False


def _preset(system: System, title: str, path: Path | None) -> FileContent:
    return FileContent("preset", title, system, random_drive(system), path=path)


def _picture(path: Path) -> FileContent:
    picture = read_picture(path)
    depth = depth_beside(path)
    notes = picture.notes + ((f"{depth.name} beside it isn't used",) if depth else ())
    target_spec, pictures = TargetSpec(picture, path.name), animation_count(path)
    return FileContent("picture", path.name, target_spec=target_spec, path=path, notes=notes, pictures=pictures)


def _stack(path: Path) -> FileContent:
    return FileContent("stack", path.name, target_spec=TargetSpec(path, path.name), path=path)


def _folder(path: Path, system: System) -> FileContent:
    """A folder of patterns as `holoview export` writes them, else a focal stack, or a folder of views."""
    patterns = sorted(path.glob("slm[12]*.png"))
    return _patterns(patterns, system) if patterns else _stack(path)


# --- patterns -------------------------------------------------------------------------------------------------------


def is_pattern_png(path: Path, system: System) -> bool:
    """Whether a PNG is marked as a modulator's pattern by its metadata, or is grey with the modulator's pixel count."""
    try:
        with opened_file(path, "a picture") as file, Image.open(file, formats=("PNG",)) as image:
            if "holoview.pattern" in getattr(image, "text", {}):
                return True
            if system.is_field:
                return False
            rows, columns = system.modulators[0].shape
            return image.size == (columns, rows) and image.mode in ("L", "I;16", "I")
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        return False


def _patterns(paths: list[Path], system: System) -> FileContent:
    """One PNG for each frame and modulator, assigned by "slm1" and "slm2" in the names, else in the given order."""
    if system.is_field:
        remedy = "open a preset first; --parts opens files that are the parts of a field"
        raise UserError("patterns", "for a field", expected="a bench with modulators", remedy=remedy)
    frames, modulators, *shape = system.drive_shape
    if len(paths) != frames * modulators:
        raise UserError(
            "patterns",
            f"{len(paths)} files",
            expected=f"{frames * modulators} for {system.name or 'this bench'}: one a frame and modulator",
            remedy="choose all of them at once, or another bench first",
        )
    groups = [[path for path in paths if f"slm{number}" in path.stem] for number in range(1, modulators + 1)]
    if any(len(group) != frames for group in groups):
        groups = [paths[number * frames : (number + 1) * frames] for number in range(modulators)]
    drive = np.stack([np.stack([read_pattern(path, (shape[0], shape[1])) for path in group]) for group in groups], 1)
    return FileContent("patterns", paths[0].parent.name or paths[0].name, drive=drive)


# --- pixels from the clipboard --------------------------------------------------------------------------------------


_PASTED = "pasted picture"
_PASTED_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TIFF", "WEBP")  # Pillow knows others that run programs


def target_from_pixels(pixels: NDArray[np.uint8], title: str = _PASTED) -> TargetSpec:
    """A target from 8-bit sRGB pixels (y, x, 3 or 4), composited over black. Raises UserError for another shape."""
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.size == 0:
        raise UserError(title, f"pixels of shape {pixels.shape}", expected="(y, x, 3) or (y, x, 4)")
    light = srgb_decode(pixels[..., :3] / 255.0)
    if pixels.shape[2] == 4:
        light = light * (pixels[..., 3:] / 255.0)
    return TargetSpec(Picture(light.astype(np.float32), title), title)


def target_from_image_bytes(data: bytes) -> TargetSpec:
    """A target from the bytes of a picture file, e.g. of the clipboard. Raises UserError when they aren't a picture."""
    try:
        with Image.open(io.BytesIO(data), formats=_PASTED_FORMATS) as image:
            require_picture_memory(Path(_PASTED), image.width, image.height, len(image.getbands()))
            return target_from_pixels(np.asarray(image.convert("RGBA")))
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise UserError(_PASTED, "isn't a picture", expected="a picture, e.g. PNG") from error


# --- Polls a file and reports when another program has rewritten it ---


POLL_INTERVAL_S = 0.4
_Signature = tuple[int, int, int] | None


class FileWatcher:
    """Calls `on_change` on its own thread when a file was rewritten and then stayed the same for one interval.

    A file may be missing for a while, as programs replace files by renaming. Rewriting the same content counts as a
    change.
    """

    def __init__(self, path: Path, on_change: Callable[[], None], interval_s: float = POLL_INTERVAL_S) -> None:
        self.path = path
        self._on_change, self._interval_s = on_change, interval_s
        self._is_closed = Event()
        self._reported = _signature(path)
        Thread(target=self._run, name=f"holoview: watch {path.name}", daemon=True).start()

    def close(self) -> None:
        """Ends the thread."""
        self._is_closed.set()

    def _run(self) -> None:
        previous = self._reported
        while not self._is_closed.wait(self._interval_s):
            current = _signature(self.path)
            if current is not None and current == previous and current != self._reported:
                self._reported = current
                self._on_change()
            previous = current


def _signature(path: Path) -> _Signature:
    """Modification time, size and inode of a file, one of which changes when it is written; None if it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
