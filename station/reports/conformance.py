"""The record of a driver's trials, its page, and the proof that both are as they were written.

The record states its own SHA-256, the page that of the record. With a key the record is signed (Ed25519): who knows the
public key sees who has tried the driver.
"""

import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput
from station.common.durable_files import read_own, write_whole
from station.common.signature import ProofCheck, check_entry, create_key, signature_entry
from station.common.versions import software
from station.reports.page import KeyNumbers, Note, Section, Table, page
from station.results.result_files import json_text

RECORD, PAGE = "conformance.json", "conformance.html"
FORMAT = "calibration-station conformance 1"
DIGEST, SIGNATURE = "sha256", "signature"
STATED = re.compile(rb"SHA-256 ([0-9a-f]{64})")


def source_of(module: str) -> dict[str, str]:
    """The module of a driver and the SHA-256 of its file."""
    file = getattr(sys.modules.get(module), "__file__", None)
    return {"module": module, "sha256": hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""}


def conformance_record(
    driver: str,
    *,
    at: str,
    identity: Mapping[str, str],
    source: Mapping[str, str],
    seed: int,
    operations: int,
    trials: Sequence[Any],
) -> dict[str, Any]:
    """The record of all trials of a driver at its twin or at a port; `trials` are TrialResults."""
    return {
        "format": FORMAT,
        "driver": driver,
        "at": at,
        "identity": dict(identity),
        "source": dict(source),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "seed": seed,
        "operations": operations,
        "kept": all(trial.kept for trial in trials),
        "trials": [asdict(trial) for trial in trials],
        "software": software(),
        "platform": f"Python {platform.python_version()}, {platform.platform()}",
    }


def write_conformance(folder: Path, record: Mapping[str, Any], key: Path | None = None) -> tuple[Path, Path]:
    """Write record and page; signed if there is a key, which is created on first use. Raises BadInput."""
    digest = _digest(record)
    if key is not None and not key.exists():
        create_key(key)
    signature = {SIGNATURE: signature_entry(digest, key)} if key is not None else {}
    whole = {**record, DIGEST: digest, **signature}
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / RECORD, folder / PAGE
    for path, text in zip(paths, (json_text(whole), conformance_page(whole)), strict=True):
        write_whole(path, text.encode())
    return paths


def _digest(record: Mapping[str, Any]) -> str:
    contents = {name: value for name, value in record.items() if name not in (DIGEST, SIGNATURE)}
    return hashlib.sha256(json_text(contents).encode()).hexdigest()


def conformance_page(record: Mapping[str, Any]) -> str:
    """The page of a record with its digest."""
    kept = sum(one["kept"] for one in record["trials"])
    identity = record["identity"]
    verdict = "ok" if record["kept"] else "refused"
    heading = f"{record['driver']}: {'every promise kept' if record['kept'] else 'promises broken'}"
    rows = [[one["trial"], "kept" if one["kept"] else "BROKEN", one["figure"]] for one in record["trials"]]
    conditions = [
        ["Device", f"{identity.get('model', '')} {identity.get('firmware', '')}".strip()],
        ["Tried at", record["at"]],
        ["Driver", f"{record['source']['module']}, SHA-256 of its file {record['source']['sha256'] or 'unknown'}"],
        ["Random operations", f"{record['operations']}, seed {record['seed']}"],
        ["Made", record["made"]],
        ["With", f"calibration-station {record['software'].get('version') or 'not installed'}, {record['platform']}"],
    ]
    signed = record.get(SIGNATURE)
    proof = [f"Record {RECORD}, SHA-256 {record[DIGEST]}."]
    if signed:
        proof.append(f"Signed with {signed['algorithm']}, public key {signed['public_key']}.")
    proof.append("`station conform --verify FOLDER` compares page, record, signature and driver.")
    return page(
        f"Conformance of {record['driver']}",
        [
            Section(
                heading, [KeyNumbers([(f"{kept} of {len(rows)}", "promises kept")])], verdict=verdict,
                kicker="Trials of a driver",
            ),
            Section("Trials", [Table(rows, ("trial", "promise", "figure"), columns="wwr")]),
            Section("Conditions", [Table(conditions, columns="wr", style="conditions")]),
            Section("Proof", [Note(one) for one in proof]),
        ],
    )  # fmt: skip


def check_conformance(folder: Path, key: Path | None = None) -> Iterator[ProofCheck]:
    """Compare record, page, signature and driver; with a key, the signature must be its own. Raises BadInput."""
    try:
        record = json.loads(read_own(folder / RECORD))
        if record["format"] != FORMAT:
            raise ValueError(f"its format is {record['format']}")
        digest, stated, source = _digest(record), str(record[DIGEST]), dict(record["source"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{folder / RECORD} is no record of a conformance: {error}", "name its folder") from error
    same = digest == stated
    yield ProofCheck(
        "record", same, "has the digest that it states" if same else "has been changed since it was written"
    )
    yield _page_check(folder, digest)
    yield check_entry(record.get(SIGNATURE), digest, key)
    yield _source_check(source)


def _page_check(folder: Path, digest: str) -> ProofCheck:
    try:
        stated = STATED.findall(read_own(folder / PAGE))
    except OSError:
        return ProofCheck("page", None, f"{PAGE} is not beside the record")
    good = digest.encode() in stated
    return ProofCheck("page", good, "states the digest of the record" if good else "states another digest")


def _source_check(source: Mapping[str, str]) -> ProofCheck:
    from importlib import import_module

    try:
        import_module(source["module"])
    except ImportError:
        return ProofCheck("driver", None, f"{source['module']} is not installed here")
    same = source_of(source["module"])["sha256"] == source["sha256"]
    return ProofCheck("driver", same, "is the one that was tried" if same else "has been changed since it was tried")
