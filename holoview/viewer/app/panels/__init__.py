"""The panels of the viewer, those of one subject in a module; their order is that of the tabs in a dock."""

from __future__ import annotations

from holoview.viewer.app.panel import Panel
from holoview.viewer.app.panels.drawing import DrawingPanel
from holoview.viewer.app.panels.element import ElementPanel
from holoview.viewer.app.panels.eye import EyePanel
from holoview.viewer.app.panels.files import FilesPanel, HistoryPanel
from holoview.viewer.app.panels.focus import FocusPanel
from holoview.viewer.app.panels.gamut import GamutPanel
from holoview.viewer.app.panels.holograms import HologramsPanel
from holoview.viewer.app.panels.image import ImagePanel
from holoview.viewer.app.panels.lasers import LasersPanel
from holoview.viewer.app.panels.optimise import OptimisePanel
from holoview.viewer.app.panels.parameters import BenchPanel, EffectsPanel
from holoview.viewer.app.panels.point import PointPanel, SectionsPanel
from holoview.viewer.app.panels.recording import RecordingPanel
from holoview.viewer.app.panels.regions import RegionsPanel
from holoview.viewer.app.panels.rig import CameraPanel, RigDiagnosisPanel, RigPanel
from holoview.viewer.app.panels.speckle import SpecklePanel
from holoview.viewer.app.panels.sweep import SweepPanel
from holoview.viewer.app.panels.view_settings import ViewPanel

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
    SweepPanel,
    FilesPanel,
    HistoryPanel,
    FocusPanel,
    HologramsPanel,
    RegionsPanel,
    DrawingPanel,
    ElementPanel,
    RigPanel,
    CameraPanel,
    RigDiagnosisPanel,
)
