"""Every error that acausal raises, as one tree.

AcausalError
├── ModelError                  the scene itself is wrong; raised while it is composed or built
│   ├── IncompatibleError       connectors that do not fit together, or are not part of the scene
│   ├── UnconnectedError        a connector that must be connected is not
│   ├── GroundError             no ground, or grounds that contradict each other
│   ├── ParameterError          a number that is not physical: NaN, negative mass, zero axis ...
│   ├── DuplicateError          one part or connection given twice
│   ├── MasslessError           something that moves freely has no inertia
│   ├── AssemblyError           a loop cannot close, or start values cannot be met
│   ├── LockedError             the constraints leave no freedom to move
│   ├── UnderdeterminedError    fewer equations than unknowns
│   └── OverdeterminedError     more equations than unknowns
├── ExpressionError             arithmetic with symbols that has no meaning: shapes that do not fit, text, no number yet (also a TypeError)
├── UnknownVariableError        a variable or expression that does not belong to the model asked
├── StartValueError             a start value for something that cannot have one, or that is contradicted
├── OptionError                 an argument of a call that makes no sense, e.g. a negative duration (also a ValueError)
├── EquilibriumError            no equilibrium or steady motion was found
├── MotionError                 a prescribed motion that the mechanism, or the forces asked for, cannot make
├── SimulationError             integration stopped early; carries the status and the trajectory so far
└── ExportError                 a file or library could not be written or compiled

A message says what is wrong, where (component path and file:line), with which values, and what to try; docs/messages.md shows some.
"""

from __future__ import annotations

from typing import Any


class AcausalError(Exception):
    """Root of all errors raised on purpose by acausal."""


class ModelError(AcausalError):
    """The scene is wrong: it cannot be a physical mechanism as composed."""

    reactions: tuple[Any, ...] = ()
    """Those (`ac.Reaction`) that other things decide: with another one in the place of one of these the scene may be right, see `ac.OneWay`."""


class IncompatibleError(ModelError):
    """Connectors of different kinds were joined, or one does not belong to the scene."""


class UnconnectedError(ModelError):
    """A connector that must be connected is not."""


class GroundError(ModelError):
    """The scene has no ground, or several that contradict each other."""


class ParameterError(ModelError):
    """A number given to a component is not physical."""


class DuplicateError(ModelError):
    """The same part stands in the scene twice, or a connection was made twice."""


class MasslessError(ModelError):
    """A motion has no inertia to resist it, so its acceleration is undefined."""


class AssemblyError(ModelError):
    """A loop cannot close, or start values cannot be met; the message gives the smallest gap reached."""


class LockedError(ModelError):
    """The constraints leave the mechanism no freedom, or digits do not tell whether they leave one."""


class UnderdeterminedError(ModelError):
    """Fewer equations than unknowns."""


class OverdeterminedError(ModelError):
    """More equations than unknowns, or equations that contradict each other."""


class ExpressionError(AcausalError, TypeError):
    """Something was done with symbolic expressions that has no meaning, e.g. `if hinge.q:` or a sum of vectors of different lengths."""


class UnknownVariableError(AcausalError):
    """A variable or expression does not belong to the model that was asked."""


class StartValueError(AcausalError):
    """A start value was given for something that cannot have one, or contradicts the others."""


class OptionError(AcausalError, ValueError):
    """An argument of a call is out of its range."""


class NoRuntimeError(OptionError):
    """The integrators in C are not there: neither built with the package, nor to be compiled now."""


class EquilibriumError(AcausalError):
    """No equilibrium or steady motion was found near the start; the message says what keeps moving."""


class MotionError(AcausalError):
    """A prescribed motion cannot be made: by the mechanism, or by the forces that were asked for."""


class ExportError(AcausalError):
    """A file or library could not be written, compiled or loaded."""


class CacheError(ExportError):
    """Compiled code could not be kept."""


class NoCompilerWarning(UserWarning):
    """The integrators in C are not there, nor a compiler to build them; CasADi's own take their place."""


class RoundingWarning(UserWarning):
    """A tolerance asks for more than numbers of 53 bits can hold."""


class JumpWarning(UserWarning):
    """A motion that is given as a function of time has a jump, in its position or its speed; no force can make it."""


class SingularWarning(UserWarning):
    """A motion came to a singular position, of a loop or of a wheel that falls flat; what follows is not reliable."""


class AccuracyWarning(UserWarning):
    """The invariants or the energy balance of a motion are off by far more than the tolerance explains; the motion is not reliable."""


class InertiaWarning(UserWarning):
    """A file gives links an inertia that no body has; they have it all the same."""


class ContactWarning(UserWarning):
    """A contact pulled at what it touches, which only something glued can do; the motion is that of a contact that never ends."""


class SimulationError(AcausalError):
    """Integration stopped before the end.

    `trajectory` holds everything computed until then and its `status` says why it stopped; None for sensitivities.
    """

    def __init__(self, message: str, trajectory: Any) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[Any, ...]:
        """Other processes hand errors over, too."""
        return type(self), (self.args[0], self.trajectory)


class OptimalControlError(AcausalError):
    """No optimal motion was found. `best` holds the last iterate, None where there is none."""

    def __init__(self, message: str, best: Any) -> None:
        super().__init__(message)
        self.best = best

    def __reduce__(self) -> tuple[Any, ...]:
        """Other processes hand errors over, too."""
        return type(self), (self.args[0], self.best)
