"""Where faults get in: between the rig and the engine, and nowhere behind the gate.

The engine passes what it sees and what it commands through a tap. An empty one changes nothing. An
injected fault is a function of what passes; it sits before the monitors and before the gate, so that
whatever it does, they have to deal with it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from vita.types import Feature, JointStep, Observation

SeenFault = Callable[[Observation], Observation]
FeatureFault = Callable[[Mapping[str, Feature], Observation], Mapping[str, Feature]]
StepFault = Callable[[JointStep], JointStep]


@dataclass
class Tap:
    """The faults in force, by their row of the catalogue."""

    seen: dict[str, SeenFault] = field(default_factory=dict)
    """What befalls the observation; may raise what a camera or a driver would raise."""
    features: dict[str, FeatureFault] = field(default_factory=dict)
    """What befalls the trackers' reports; may raise what a tracker would raise."""
    step: dict[str, StepFault] = field(default_factory=dict)
    """What befalls the servo's answer on its way to the rig."""
    undo: dict[str, Callable[[], None]] = field(default_factory=dict)
    """How to take back what an injector did elsewhere."""

    @property
    def rows(self) -> tuple[str, ...]:
        """The rows in force."""
        return tuple(sorted({*self.seen, *self.features, *self.step, *self.undo}))

    def observation(self, seen: Observation) -> Observation:
        for fault in list(self.seen.values()):
            seen = fault(seen)
        return seen

    def reports(self, features: Mapping[str, Feature], seen: Observation) -> Mapping[str, Feature]:
        for fault in list(self.features.values()):
            features = fault(features, seen)
        return features

    def command(self, step: JointStep | None) -> JointStep | None:
        if step is not None:
            for fault in list(self.step.values()):
                step = fault(step)
        return step

    def mend(self) -> None:
        """Take back every fault."""
        undo, self.undo = list(self.undo.values()), {}
        for faults in (self.seen, self.features, self.step):
            faults.clear()
        for back in undo:
            back()
