"""What a search works with, from captures whose records are right."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

from holoview.captures.dataset import Captures
from holoview.captures.patterns import pattern_roughness
from holoview.captures.prepared_captures import prepare_captures
from holoview.diagnose.bad_captures import BadCapture
from holoview.diagnose.capture_split import split_captures
from holoview.diagnose.comparison import Values
from holoview.diagnose.config import SearchConfig
from holoview.diagnose.extended_model import PredictorWithKnownEffects
from holoview.diagnose.sampling_config import SamplingConfig
from holoview.diagnose.search_context import NeighbourVariances, PerThreadPredictor, SearchContext, equivalent_effects
from holoview.diagnose.worker_pool import WorkerPool
from holoview.model.effects.active_effects import ActiveEffects
from holoview.model.effects.effect import Effect
from holoview.util.errors import UserError


def prepare_search(
    captures: Captures,
    useless: Sequence[BadCapture],
    effects: Sequence[Effect],
    known: Values,
    sampling: SamplingConfig,
    config: SearchConfig,
    pool: WorkerPool,
) -> tuple[SearchContext, list[str]]:
    """What a search works with, and notes on what these captures can't show.

    useless: captures that are left out. effects: the candidates. known: effects that the nominal model has. Raises
    UserError when no capture is left.
    """
    left_out = tuple(bad.index for bad in useless)
    kept = [k for k in range(len(captures)) if k not in left_out]
    if not kept:
        raise UserError("captures", "every one is dark or saturated", remedy="check shutter and exposures")
    properties = (captures.subset(kept) if left_out else captures).data_properties()
    unmet = {e.id: e.needs.unmet_by(properties) for e in effects}
    visible = {e.id: e for e in effects if not unmet[e.id]}
    notes = [f"{name} can't be seen in these captures: {why}." for name, why in unmet.items() if why]
    if properties.wavelengths == 1:
        notes.append("With one wavelength, errors of the wavelength and of distances can't be told apart.")
    if properties.planes == 1 and not properties.is_fourier:
        notes.append("With one plane, a wrong wavelength looks much like a wrong distance.")
    options = {"captures": captures, "known_values": known, **dataclasses.asdict(sampling)}
    data = prepare_captures(captures)
    context = SearchContext(
        data=data,
        system=ActiveEffects(known).actual_system(captures.nominal_system()),
        effects=visible,
        split=split_captures(captures, pattern_roughness(captures), config.split, left_out),
        predictor=PerThreadPredictor(partial(PredictorWithKnownEffects, **options)),
        workers=pool,
        variances=NeighbourVariances(data),
        config=config,
        sampling=sampling,
        equivalents=equivalent_effects(visible, properties),
        left_out=left_out,
    )
    return context, notes
