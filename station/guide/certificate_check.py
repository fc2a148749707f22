"""A certificate compared with its record, the record with the originals, and the numbers with their recomputation."""

import hashlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from procedures.outcome import BadInput, ProcedureError
from station.common.durable_files import holds, read_own
from station.common.models import TableSource, read_model
from station.common.sanitise import printable
from station.common.signature import ProofCheck, check_signature
from station.guide.recompute import recompute
from station.procedure.schema import procedure_named
from station.reports.certificate import PAGE, record_digest
from station.reports.certificate_details import SIGNATURE, STATEMENT, read_statement
from station.results.measurement import BY_PLANE, Measurement
from station.results.plane_result import PlaneResult
from station.results.reader import read_record, read_result
from station.results.result_files import RECORD, damage, json_object
from station.results.terms import Terms
from station.results.units import Unit

STATED = re.compile(rb'record-sha256(?:" content="| )([0-9a-f]{64})')
"""The digest in the head of the page, and among the keywords of the PDF."""
SAME_SIGMAS = 0.01
"""Numbers computed on another processor differ by less than this fraction of their standard uncertainty, or value."""
SIGMAS = "standard uncertainties"
Difference = tuple[str, float, str]
DERIVED = "derived"


def check_certificate(path: Path, originals: Path | None = None, signer: Path | None = None) -> Iterator[ProofCheck]:
    """The checks of certificate.html or .pdf, each as it is done. Raises BadInput if it is no such file with a digest.

    originals : photographs' folder, if they moved
    signer : file with the key of the expected signer, or folder of `.pub` files with those of several
    """
    path = path.resolve() if path.is_symlink() else path
    try:
        match = STATED.search(read_own(path))
    except OSError as error:
        raise BadInput(f"{printable(path)} cannot be read: {error.strerror}", "name a certificate") from error
    if match is None:
        raise BadInput(
            f"{printable(path)} states no digest of a record", "name certificate.html or certificate.pdf of a result"
        )
    digest = match[1].decode()
    signature = _signature_check(path, digest, signer)
    yield signature
    folder = _result_of(path.parent, digest)
    if folder is None:
        words = f"no record beside {printable(path.name)} has the digest {digest[:16]}…: it has been changed or moved"
        yield ProofCheck("record", False, words)
        return
    yield ProofCheck("record", True, f"{printable(folder / 'result.json')} has the digest of the certificate")
    changed = damage(folder) or _changed_copy(path, folder)
    words = f"changed or missing: {', '.join(map(printable, changed))}" if changed else "as they were written"
    yield ProofCheck("files of the result", not changed, words)
    if folder.parent.name == DERIVED:
        if signature.agrees is None:
            yield _statement_check(path, digest)
        yield from _session_checks(folder)
    else:
        yield from _result_checks(read_result(folder), originals)


def _signature_check(path: Path, digest: str, signer: Path | None) -> ProofCheck:
    """Whether the file is as it was signed, and by whom."""
    try:
        statement, signature = (read_own(path.with_name(name)) for name in (STATEMENT, SIGNATURE))
    except OSError:
        words = f"{SIGNATURE} is not beside the certificate: it is not signed"
        return ProofCheck("signature", None if signer is None else False, words)
    signed = read_statement(statement)
    if signed["record"] != digest or signed[path.name] != hashlib.sha256(read_own(path)).hexdigest():
        return ProofCheck("signature", False, f"{printable(path.name)} has been changed since it was signed")
    return check_signature(statement, signature, signed["public key"], signer, signed["signed by"])


def _statement_check(path: Path, digest: str) -> ProofCheck:
    """Whether an unsigned certificate of a session is as the statement beside it says."""
    try:
        stated = read_statement(read_own(path.with_name(STATEMENT)))
    except OSError:
        words = f"{STATEMENT} is not beside the certificate: edited text is not detected"
        return ProofCheck("certificate", None, words)
    if stated["record"] != digest or hashlib.sha256(read_own(path)).hexdigest() not in stated.values():
        return ProofCheck("certificate", False, f"{printable(path.name)} has been changed since it was written")
    return ProofCheck("certificate", True, "as it was written")


def _changed_copy(path: Path, folder: Path) -> tuple[str, ...]:
    """The name of a certificate that is none of the files of a result which has one."""
    files = json_object(folder / RECORD).get("files", {})
    return (path.name,) if PAGE in files and not any(holds(path, one) for one in files.values()) else ()


def _result_of(folder: Path, digest: str) -> Path | None:
    """The folder of the record with the digest: this one, or that of a result of the session in it."""
    for one in (folder, *sorted(folder.glob(f"{DERIVED}/*"))):
        try:
            if record_digest(read_record(one)) == digest:
                return one
        except BadInput:
            continue
    return None


def _session_checks(folder: Path) -> Iterator[ProofCheck]:
    """A session keeps its photographs, and its journal the hashes of everything."""
    session, results = folder.parents[1], sorted(folder.parent.iterdir(), key=lambda one: (len(one.name), one.name))
    try:
        (again,) = recompute(session, (results.index(folder) + 1,))
    except ProcedureError as error:
        yield ProofCheck("originals", False, str(error))
        return
    yield ProofCheck("originals", True, "every photograph of the session is unchanged")
    moved = [(one.number, abs(one.sigmas), SIGMAS) for one in again.moved]
    yield _number_check(again.numbers, moved, [words for words, *_ in again.verdicts])


def _result_checks(measurement: Measurement, originals: Path | None) -> Iterator[ProofCheck]:
    head = measurement.head
    places = dict[str, Path | None]()
    for file in head.input:
        path = Path(file.path)
        beside = sorted(originals.rglob(path.name)) if originals is not None else []
        places[file.path] = next((one for one in (*beside, path) if holds(one.resolve(), file.sha256)), None)
    missing = [printable(name) for name, place in places.items() if place is None]
    words = f"changed or missing: {', '.join(missing)}" if missing else f"{len(places)} of {len(places)} unchanged"
    yield ProofCheck("originals", not missing, words)
    if missing:
        return
    if head.arguments is None or head.settings is None:
        yield ProofCheck("numbers", None, "the record is of an earlier version that did not state its settings")
        return
    moved = {Path(name).resolve(): place for name, place in places.items() if place is not None}
    arguments = [moved.get(Path(argument).resolve(), originals or Path(argument)) for argument in head.arguments]
    try:
        procedure = procedure_named(head.procedure)
        model = read_model(procedure.Settings, head.settings, TableSource())
        fresh = next(
            iter(procedure.measurements(arguments, model, Terms(Unit(head.parameters.get("unit", Unit.CYCLES)))))
        )
    except ProcedureError as error:
        yield ProofCheck("numbers", False, f"they cannot be computed again: {error}")
        return
    again = fresh.by_name  # the record of a single result does not state its name
    if measurement.results_key != BY_PLANE:
        again = {measurement.planes[0].name: fresh.planes[0]}
    pairs = [(plane, again[plane.name]) for plane in measurement.planes if plane.name in again]
    differences = [difference for one, other in pairs for difference in _differences(one, other)]
    verdicts = [one.name for one, other in pairs if one.verdict is not other.verdict]
    lost = [plane.name for plane in measurement.planes if plane.name not in again]
    yield _number_check(len(differences), differences, [*verdicts, *lost])


def _differences(one: PlaneResult, other: PlaneResult) -> Iterator[Difference]:
    """The differences of the numbers that both have, in standard uncertainties; of others relative to their values."""
    for name in (*one.numbers, *(name for name in one.values if name not in one.numbers)):
        known, again = one.quantity(name), other.quantity(name)
        if known is not None and again is not None:
            size = abs(again.value - known.value) / (known.uncertainty or abs(known.value) or 1)
            yield f"{one.name} {name}", size, SIGMAS if known.uncertainty else "of the value"


def _number_check(count: int, differences: Sequence[Difference], verdicts: Sequence[str]) -> ProofCheck:
    """The check of numbers that differ, and of planes with another verdict."""
    moved = sorted((difference for difference in differences if difference[1] > SAME_SIGMAS), key=lambda one: -one[1])
    if not moved and not verdicts:
        return ProofCheck("numbers", True, f"{count} of {count} computed again and equal")
    words = [f"{name} by {size:.2g} {unit}" for name, size, unit in moved[:3]]
    words += [f"the verdict of {name}" for name in verdicts]
    return ProofCheck("numbers", False, f"computed again, {len(moved)} of {count} differ: {', '.join(words)}")
