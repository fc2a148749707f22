"""`station verify`: a certificate compared with its record and its originals."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from procedures.outcome import BadInput
from station.cli.result_log import check_strict
from station.cli.terminal.command import command
from station.cli.terminal.progress import awaited
from station.common.errors import log


@command("verify", strict=True, as_json=True)
@click.argument("certificate", type=click.Path(path_type=Path))
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
        log("verify", f"{one.name} {AGREES[one.agrees]}: {one.words}", level="info" if one.agrees else "warning")
        checks.append(one)
    if as_json:
        click.echo(json.dumps({"certificate": str(certificate), "checks": [asdict(one) for one in checks]}, indent=1))
    if any(one.agrees is False for one in checks):
        raise click.exceptions.Exit(BadInput.exit_code)
    check_strict(("pass" if one.agrees else "doubtful" for one in checks), strict=strict)
