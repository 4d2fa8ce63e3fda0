"""Laws by which contacts push in motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from tdcr._arrays import as_float, as_number
from tdcr.errors import InputError


@dataclass(frozen=True)
class Compliant:
    """A spring of the obstacle's compliance beside a damper, with the obstacle's friction: the law of scenes that have no other.

    Attributes:
        relaxation: Time in which a pressed surface comes back (s), from 0 to 1.

    Raises:
        InputError: For what is no finite number.
    """

    relaxation: float = 1e-3

    def __post_init__(self) -> None:
        object.__setattr__(self, "relaxation", as_number(self.relaxation, "relaxation"))

    def _fields(self) -> dict[str, Any]:
        """What a scene's file says of it."""
        return {"compliant": {"relaxation": self.relaxation}}


@dataclass(frozen=True)
class Impedance:
    """MuJoCo's law, without friction, whatever the obstacles' compliance and friction. Discs of the robot do not touch each other
    under it, and motions have no derivatives. The defaults are MuJoCo's.

    Attributes:
        solref: Time constant (s) and damping ratio, shape (2,), both above 0.
        solimp: The impedance at no overlap and at the width, the width (m), midpoint and power of the curve between, shape (5,).

    Raises:
        InputError: For values of the wrong type or shape, or not finite.
    """

    solref: Any = (0.02, 1.0)
    solimp: Any = (0.9, 0.95, 0.001, 0.5, 2.0)

    def __post_init__(self) -> None:
        for name, count in (("solref", 2), ("solimp", 5)):
            object.__setattr__(self, name, tuple(as_float(getattr(self, name), name, (count,)).tolist()))

    def _fields(self) -> dict[str, Any]:
        """What a scene's file says of it."""
        return {"impedance": {"solref": self.solref, "solimp": self.solimp}}


ContactLaw: TypeAlias = Compliant | Impedance
"""How contacts push in motion."""


def law_of(fields: dict[str, Any] | None) -> ContactLaw:
    """The law of which a scene's file says this; the usual one where it says nothing."""
    if fields is None:
        return Compliant()
    ((kind, values),) = fields.items()
    return Compliant(**values) if kind == "compliant" else Impedance(**values)


def law_fields(law: Any) -> dict[str, Any]:
    """What a scene's file says of a law, if it is one."""
    if not isinstance(law, Compliant | Impedance):
        raise InputError(f"contact_law is {law!r}; expected a tdcr.Compliant or a tdcr.Impedance")
    return law._fields()
