"""The panels of the viewer, those of one subject in a module; their order is that of the tabs in a dock."""

from __future__ import annotations

from holoview.app.panel import Panel
from holoview.app.panels.eye import EyePanel
from holoview.app.panels.files import FilesPanel, HistoryPanel
from holoview.app.panels.focus import FocusPanel
from holoview.app.panels.gamut import GamutPanel
from holoview.app.panels.image import ImagePanel
from holoview.app.panels.lasers import LasersPanel
from holoview.app.panels.optimise import OptimisePanel
from holoview.app.panels.parameters import BenchPanel, EffectsPanel
from holoview.app.panels.point import PointPanel, SectionsPanel
from holoview.app.panels.recording import RecordingPanel
from holoview.app.panels.rig import CameraPanel, RigDiagnosisPanel, RigPanel
from holoview.app.panels.speckle import SpecklePanel
from holoview.app.panels.view_settings import ViewPanel

ALL: tuple[type[Panel], ...] = (
    ImagePanel,
    BenchPanel,
    EffectsPanel,
    EyePanel,
    LasersPanel,
    GamutPanel,
    ViewPanel,
    SpecklePanel,
    SectionsPanel,
    PointPanel,
    RecordingPanel,
    OptimisePanel,
    FilesPanel,
    HistoryPanel,
    FocusPanel,
    RigPanel,
    CameraPanel,
    RigDiagnosisPanel,
)
