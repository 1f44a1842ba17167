"""A diagnosis as one HTML file with its pictures inside, and the pictures as PNG files beside it."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path

from holoview.diagnose import plots
from holoview.diagnose.diagnosis import Cause, Diagnosis
from holoview.diagnose.display_gain import DisplayGain
from holoview.diagnose.formatting import format_value
from holoview.util.files import atomic_write
from holoview.util.progress import ProgressCallback

_MEANS = {
    "consistent": "Nothing is wrong beyond the noise.",
    "explained": "One cause, or several together, explain the captures down to the noise.",
    "partly-explained": "The causes below explain a good part; something else is wrong too.",
    "ambiguous": "More than one explanation fits; these captures can't tell which is true.",
    "unexplained": "Something is wrong that no effect of the library explains.",
}
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; color: #222; }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin-top: 2rem } img { max-width: 100%; height: auto }
table { border-collapse: collapse } td, th { padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums }
.verdict { font-size: 1.3rem; font-weight: 600 } .quiet { color: #666 } .cause { margin: 1rem 0 1.5rem }
"""


def write_report(
    folder: Path,
    title: str,
    diagnosis: Diagnosis,
    gain: DisplayGain | None = None,
    progress: ProgressCallback | None = None,
) -> Path:
    """Writes report.html and its PNG files into the folder; the path of the HTML file."""
    pictures = {
        "residuals": plots.residual_maps(diagnosis.samples),
        "excess": plots.excess_bars(diagnosis),
        "held-out": plots.held_out_psnr_bars(diagnosis),
        "candidates": plots.candidate_excess_bars(diagnosis),
    }
    encoded = {}
    for number, (name, figure) in enumerate(pictures.items()):
        encoded[name] = plots.to_png(figure)
        if progress is not None:
            progress(number + 1, len(pictures) + 1, name)
    if gain is not None:
        encoded["display"] = gain.sheet
    for name, data in encoded.items():
        with atomic_write(folder / f"{name}.png") as temporary:
            temporary.write_bytes(data)
    path = folder / "report.html"
    with atomic_write(path) as temporary:
        temporary.write_text(_page(title, diagnosis, encoded, gain), encoding="utf-8")
    if progress is not None:
        progress(len(pictures) + 1, len(pictures) + 1, "report.html")
    return path


def _page(title: str, found: Diagnosis, pictures: dict[str, bytes], gain: DisplayGain | None) -> str:
    before, after = found.before, found.after
    parts = [
        f"<h1>Diagnosis of {escape(title)}</h1>",
        f'<p class="verdict">{escape(found.verdict)}</p><p>{_MEANS[found.verdict]}</p>',
        "<p>On captures that no fit has seen: χ²/n "
        f"{before.chi2_per_pixel:.4g} → <b>{after.chi2_per_pixel:.4g}</b> (the noise alone gives 1), "
        f"PSNR {before.psnr_db:.1f} → <b>{after.psnr_db:.1f} dB</b>, "
        f"share of the signal explained {found.signal_explained[0]:.2%} → <b>{found.signal_explained[1]:.3%}</b>.</p>",
        *(_cause(cause) for cause in found.causes),
        _rivals(found),
        _lives_in(found),
        f"<h2>Held-out captures</h2>{_image(pictures['held-out'], 'PSNR by wavelength and plane')}",
        "<h2>Residuals</h2><p>Held-out captures. The border, saturated and dead pixels are left out.</p>"
        f"{_image(pictures['residuals'], 'captures, predictions and residuals')}",
        f"<h2>Where the error lives</h2>{_image(pictures['excess'], 'chi square by property')}",
        f"<h2>What was tried</h2>{_image(pictures['candidates'], 'candidates')}",
        _display(gain, pictures),
        _notes(found),
    ]
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}: {escape(found.verdict)}'
        f"</title><style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def _cause(cause: Cause) -> str:
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{escape(format_value(cause.effect, name, i))}</td></tr>'
        for name, i in cause.intervals.items()
    )
    looks = ", ".join(f"{escape(name)} ({value:.2f})" for name, value in cause.confounded_with.items())
    return (
        f'<div class="cause"><h2>{escape(cause.sentence)}</h2><p class="quiet">{escape(cause.effect)}: '
        f"{cause.excess_explained:.1%} of the excess, {cause.gain_db:+.1f} dB</p>"
        f'<table><tr><th>parameter</th><th class="n">value, 95 % interval</th></tr>{rows}</table>'
        + (f"<p>Looks much like: {looks} (correlation of what they change).</p>" if looks else "")
        + (f"<p>To separate them: {escape(cause.separate_by)}.</p>" if cause.separate_by else "")
        + "</div>"
    )


def _rivals(found: Diagnosis) -> str:
    if not found.rivals:
        return ""
    items = "".join(f"<li>{escape(' and '.join(causes))}</li>" for causes in found.rivals)
    return f"<h2>Can't be excluded</h2><ul>{items}</ul>"


def _lives_in(found: Diagnosis) -> str:
    if found.unexplained <= 0 or not found.lives_in:
        return ""
    rows = "".join(f"<li>{escape(place)}: {share:.0%} of what is left</li>" for place, share in found.lives_in.items())
    return f"<h2>What is left lives in</h2><p>Free maps at each place, judged on held-out captures:</p><ul>{rows}</ul>"


def _display(gain: DisplayGain | None, pictures: dict[str, bytes]) -> str:
    if gain is None:
        return ""
    return (
        "<h2>What it buys on the display</h2>"
        f"<p>A hologram optimised with the nominal model reaches {gain.nominal_db:.1f} dB on the bench as it is; "
        f"with the extended model <b>{gain.extended_db:.1f} dB</b>, {gain.gain_db:+.1f} dB "
        f"({gain.iterations} iterations each, the mean of all focal planes).</p>"
        f"{_image(pictures['display'], 'both holograms on the bench as it is')}"
    )


def _notes(found: Diagnosis) -> str:
    facts = [
        f"Pixels differ in sensitivity by {found.fixed_pattern:.2%}." if found.fixed_pattern else "",
        f"Gains of captures vary by {found.gain_spread:.2%} about those of their wavelength; each was fitted.",
        f"Took {found.seconds:.0f} s.",
        *found.notes,
    ]
    return "<h2>Notes</h2><ul>" + "".join(f"<li>{escape(fact)}</li>" for fact in facts if fact) + "</ul>"


def _image(data: bytes, alt: str) -> str:
    return f'<img alt="{escape(alt)}" src="data:image/png;base64,{base64.b64encode(data).decode("ascii")}">'
