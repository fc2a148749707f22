"""`station explain`, why a result is as it is, and `station verify`, whether a certificate agrees with its record."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from procedures.outcome import BadInput
from station.cli.result_log import check_strict
from station.cli.terminal.command import PATH, command
from station.cli.terminal.progress import awaited, progress
from station.common.errors import log

if TYPE_CHECKING:
    from station.results.explanation import PlaneExplanation

MOST_TERMS, LEAST_SHARE = 3, 0.005
NO_BUDGET = "The record has no uncertainty budget."


@command("explain", strict=True, as_json=True)
@click.argument("result", type=PATH)
@click.option("--twin", is_flag=True, help="Predict the effect of remedies by a simulated camera (some seconds).")
def explain(result: Path, twin: bool, strict: bool, as_json: bool) -> None:
    """Explain RESULT, a result, session or batch: most likely cause, largest uncertainty, best remedy."""
    from station.results.explanation import explain_batch, is_batch, result_folder

    folder = result_folder(result)
    if not is_batch(folder):
        entry, lines, verdicts = _explained(folder, twin=twin)
        _write({"result": str(folder), **entry}, lines, as_json)
        check_strict(verdicts, strict=strict)
        return
    batch = explain_batch(folder)
    entry, lines = {"result": str(folder), **asdict(batch)}, [] if batch.causes else ["every photograph passed"]
    for cause in batch.causes:
        lines += [f"{cause.count:6d}  {cause.reason}", f"        what helps: {cause.remedy}"]
    lines += [f"outlier: {outlier}" for outlier in batch.outliers]
    if batch.typical:
        more, words, _ = _explained(Path(batch.typical), twin=twin)
        entry |= more
        lines += ["", f"Of those that passed, one with the median uncertainty, {batch.typical}:", *words]
    _write(entry, lines, as_json)
    check_strict((None for _ in batch.causes), strict=strict)


def _explained(folder: Path, *, twin: bool) -> tuple[dict[str, Any], list[str], list[str]]:
    """The explanation of a result: entry of the record, lines, and verdicts."""
    from station.results.explanation import PREDICTED, TWIN, explain_result
    from station.results.reader import read_result, record_of

    planes = explain_result(read_result(folder))
    entry: dict[str, Any] = {"planes": [asdict(plane) for plane in planes]}
    lines = [line for plane in planes for line in _plane_lines(plane)]
    first, known = planes[0], record_of(folder, planes[0].plane)
    if twin or (first.terms and PREDICTED & known.keys()):
        from station.demo.digital_twin import predictions

        budget = {part.term: part.share**0.5 * first.uncertainty for part in first.terms}
        with progress(1) as shown:
            shown("photographing with the digital twin", 0)
            effects = predictions(known, first.number, budget)
        entry["twin"] = [asdict(effect) for effect in effects]
        lines += ["", f"Predicted for {first.plane}:"]
        lines += [f"  {one.words}: {one.number}, {_fall(one.before, one.after)}" for one in effects]
    elif first.terms and TWIN & {*known, *known.get("diagnostics", {})}:
        lines.append("`--twin` predicts the effect of remedies by a simulated camera.")
    return entry, lines, [plane.verdict for plane in planes]


def _write(entry: dict[str, Any], lines: Sequence[str], as_json: bool) -> None:
    click.echo(json.dumps(entry, indent=1) if as_json else "\n".join(lines))


def _fall(before: float, after: float | None) -> str:
    if after is None:
        return "not predicted: the estimate refuses a photograph of the simulated camera"
    now, then = f"± {before:.2g}", f"± {after:.2g}"
    return f"from {now} to {then}" if now != then else f"stays {now}"


def _plane_lines(one: PlaneExplanation) -> list[str]:
    from procedures.numbers import label
    from station.results.explanation import WORDS

    lines = [f"{one.plane}: {one.verdict}" + (f", because {one.reason}" if one.reason else "")]
    lines += [f"  what helps: {one.remedy}"] if one.remedy else []
    lines += [f"  against the specification: {words}" for words in one.against]
    name = label(one.number)[:1].upper() + label(one.number)[1:] if one.number else ""
    if one.terms:
        first, *others = [part for part in one.terms[:MOST_TERMS] if part.share >= LEAST_SHARE]
        lines += [
            f"  {name} {one.value}, {first.share:.0%} of its variance: {WORDS[first.term]}.",
            f"  Best: {first.remedy}; ± falls from {one.uncertainty:.2g} to {first.uncertainty_then:.2g} at best.",
            *(f"    {part.share:4.0%} {WORDS[part.term]}; to ± {part.uncertainty_then:.2g}: {part.remedy}"
              for part in others),
        ]  # fmt: skip
    elif name:
        lines.append(f"  {name} {one.value}. {NO_BUDGET}")
    return lines


@command("verify", strict=True, as_json=True)
@click.argument("certificate", type=PATH)
@click.option(
    "--originals", type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Folder of the photographs, if they are no longer where they were measured.",
)  # fmt: skip
@click.option(
    "--signer", type=click.Path(path_type=Path, exists=True),
    help="File with the public key of the expected signer, or folder of such files (.pub).",
)  # fmt: skip
def verify(certificate: Path, originals: Path | None, signer: Path | None, strict: bool, as_json: bool) -> None:
    """Compare CERTIFICATE, a page or a PDF, with its signature and its record, and compute its numbers again.

    The record is found by the digest that the certificate states: beside it, or among the results of the session in
    whose folder it is. Exits with 4 if anything differs; with --strict, with 1 if something could not be compared.
    """
    from station.common.signature import AGREES
    from station.guide.certificate_check import check_certificate

    checks = []
    for one in awaited("computing the numbers again", check_certificate(certificate, originals, signer)):
        log("verify", f"{one.name}: {AGREES[one.agrees]}, {one.words}", level="info" if one.agrees else "warning")
        checks.append(one)
    if as_json:
        click.echo(json.dumps({"certificate": str(certificate), "checks": [asdict(one) for one in checks]}, indent=1))
    if any(check.agrees is False for check in checks):
        raise click.exceptions.Exit(BadInput.exit_code)
    check_strict(("pass" if check.agrees else "doubtful" for check in checks), strict=strict)
