"""The relays have aberrations: Zernike terms that may depend on the wavelength."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from holoview.light.model.effects.effect import Effect, Needs, Parameter, Values
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import RelayContext


_TERMS = range(
    4, 12
)  # Noll: defocus, astigmatism, coma, trefoil, spherical; piston changes no intensity, and tilts shift the picture
_REFERENCE_M = 550e-9  # wavelength at which the slopes don't count
_SLOPE_UNIT_M = 100e-9  # change of wavelength for which slopes are given


def _term(noll: int) -> Parameter:
    doc = f"Zernike term {noll} (Noll), r.m.s. optical path over the nominal iris at 550 nm."
    return Parameter(f"z{noll}", doc, "nm", low=-5e-6, high=5e-6, prior=100e-9, scan=(-400e-9, 400e-9, 100e-9))


def _slope(noll: int) -> Parameter:
    doc = f"What term {noll} gains for each 100 nm of wavelength."
    return Parameter(f"z{noll}_slope", doc, "nm", low=-2e-6, high=2e-6, prior=20e-9, secondary=True)


class Aberration(Effect):
    """pupil → pupil·exp(2πi·opd/λ) with opd = Σ_j (c_j + slope_j·(λ − 550 nm)/100 nm)·Z_j over the nominal iris.

    Where the iris is wider or off its centre, light passes beyond the nominal one: the polynomials go on there, as the
    surfaces of lenses do.
    """

    parameters = (*map(_term, _TERMS), *map(_slope, _TERMS))
    element_kinds = ("space",)
    element_id = "aberration"

    def actual_element(self, system: System, element: str, v: Values) -> System:
        way = system.way
        number = next(i for i, names in enumerate(way.relay_names) if element in names)
        if not way.relays[number].has_aperture:
            found = "has neither an iris nor a square stop, over which an aberration is told"
            raise UserError(element, found, expected="a space with one")
        return system

    def pupil(self, pupil: Tensor, context: RelayContext, v: Values) -> Tensor:
        x = (context.wavelength_m - _REFERENCE_M) / _SLOPE_UNIT_M
        terms = {noll: v[f"z{noll}"] + v[f"z{noll}_slope"] * x for noll in _TERMS}
        return context.delayed(pupil, context.zernike({noll: value for noll, value in terms.items() if value}))

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        size = sum(v[f"z{noll}"] ** 2 for noll in _TERMS) ** 0.5
        largest = max(_TERMS, key=lambda noll: abs(v[f"z{noll}"]))
        term = f"Z{largest} = {format_rounded(v[f'z{largest}'], 'nm', 3)}"
        return {"rms": format_rounded(size, "nm", 3), "largest": term}


class Aberration1(Aberration):
    """Zernike terms in the Fourier plane of relay 1. Its defocus alone is equivalent to a wrong gap."""

    id = "aberration1"
    cause = "The optics between the modulators have aberrations."
    finding = "Relay 1 has aberrations of {rms} r.m.s., {largest} above all."
    acts_on = ("relay 1",)
    degenerate_with: ClassVar = ("gap",)
    needs = Needs(modulators=2, irises=(1,), fourier=False)


class Aberration2(Aberration):
    """Zernike terms in the Fourier plane of relay 2. Its defocus alone is equivalent to a wrong distance."""

    id = "aberration2"
    cause = "The optics behind the last modulator have aberrations."
    finding = "Relay 2 has aberrations of {rms} r.m.s., {largest} above all."
    acts_on = ("relay 2",)
    degenerate_with: ClassVar = ("distance",)
    needs = Needs(irises=(2,), fourier=False)
