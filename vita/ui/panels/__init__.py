"""The panels at the right of the page."""

from vita.ui.panels.base import Desk, Panel
from vita.ui.panels.faults import FaultsPanel
from vita.ui.panels.files import FilesPanel
from vita.ui.panels.impedance import StereoPanel, TuningPanel
from vita.ui.panels.knowledge import KnowledgePanel
from vita.ui.panels.run import RunPanel
from vita.ui.panels.servo import ServoPanel
from vita.ui.panels.task import TaskPanel
from vita.ui.panels.view import ViewPanel

__all__ = [
    "Desk",
    "FaultsPanel",
    "FilesPanel",
    "KnowledgePanel",
    "Panel",
    "RunPanel",
    "ServoPanel",
    "StereoPanel",
    "TaskPanel",
    "TuningPanel",
    "ViewPanel",
]
