"""The signature of a certificate: its files by their hashes in the format of sha256sum, and the signature of that text.

`sha256sum -c certificate.sha256` and `openssl pkeyutl -verify` check both without this program.
"""

import hashlib
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from station.common.sanitise import printable
from station.common.signature import public_key, sign
from station.reports.certificate_details import CertificateDetails

STATEMENT, SIGNATURE = "certificate.sha256", "certificate.sha256.sig"


def signature_files(files: Mapping[str, bytes], record: str, details: CertificateDetails) -> dict[str, bytes]:
    """Statement and signature of files, by name; nothing without a key. Raises BadInput."""
    if not details.signing_key:
        return {}
    key = Path(details.signing_key)
    head = {"signed by": details.signer, "public key": public_key(key), "record": record}
    lines = [f"# {name}: {words}" for name, words in head.items()]
    lines += [f"{hashlib.sha256(data).hexdigest()}  {name}" for name, data in files.items()]
    statement = "".join(f"{line}\n" for line in lines).encode()
    return {STATEMENT: statement, SIGNATURE: sign(statement, key)}


def read_statement(statement: bytes) -> dict[str, str]:
    """Signer, public key and record of a statement, and hashes by file; what it lacks is empty."""
    entries: dict[str, str] = defaultdict(str)
    for line in statement.decode("utf-8", "replace").splitlines():
        if line.startswith("# "):
            name, _, words = line[2:].partition(": ")
            entries[name] = printable(words)
        else:
            digest, _, name = line.partition("  ")
            entries[name] = digest
    return entries
