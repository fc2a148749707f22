"""An example of every command, for its help and for the manual."""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, str] = {
    "pattern": "chart.pdf --paper a4",
    "psf pattern": "photo.dng --out result --report",
    "sensor": "shoot/ --out sensor --report",
    "geometry": "views/ --width-mm 155 --out geometry",
    "rig": "left/ right/ --out rig",
    "vignetting": "flats/ --out vignetting",
    "tilt": "focus-bracket/ --out tilt",
    "export": "geometry/ --to opencv camera.yml",
    "focus": "photographs/",
    "mtf edge": "photo.dng --out edge --report",
    "sharpen": "burst/*.dng --out sharp",
    "restore": "near.png far.png --blur defocus --out restored",
    "refocus": "restored/ --f-number 2.8 --focus-m 1.9 --out refocused",
    "correct": "photo.dng --field field.h5 --out corrected",
    "rays": "samples.npz --out filtered",
    "batch": "shoot/ --procedure procedure.toml --out batch",
    "explain": "result/ --twin",
    "verify": "result/certificate.pdf",
    "session list": "",
    "devices": "--simulate",
    "conform": "zaber --out conformance --key laboratory.pem",
    "serve": "--simulate",
    "simulate": "--for-s 60",
    "completion": "bash",
    "demo": "--out demo",
    "init": "",
    "manual": "psf",
    "reproduce": "--out reproduced",
    "psf witnessed": "short.dng long.dng near.dng defocused.dng --exposure-ratio 2 --out result",
    "psf two-photo": "near.dng far.dng --out result --report",
    "psf series": "aperture-series/ --out series",
    "psf field": "charts/ --out field",
    "session show": "2026-01-01-pattern",
    "session resume": "",
    "session delete": "2026-01-01-pattern",
    "session recompute": "2026-01-01-pattern",
    "session report": "2026-01-01-pattern",
    "session trend": "",
    "session index": "--rebuild",
}
"""Arguments and options by command."""
