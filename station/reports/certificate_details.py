"""A certificate's signature, and its details that no photograph holds: laboratory, customer, serial numbers, dates.

```toml
laboratory = "Optics laboratory"
logo = "logo.png"                   # beside this file
number = "2026-0117"
customer = "Example Ltd"
lens_serial = "1234567"
signing_key = "laboratory.pem"      # beside this file
```
"""

import hashlib
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from station.common.models import TableSource, read_model
from station.common.sanitise import printable
from station.common.signature import ALGORITHM, public_key, sign

STATEMENT, SIGNATURE = "certificate.sha256", "certificate.sha256.sig"


DETAILS = "certificate.toml"


@dataclass(frozen=True)
class CertificateDetails:
    """Details required by ISO/IEC 17025:2017, section 7.8.2, that a record does not hold.

    logo : path of a PNG or JPEG image
    place : where the measurement was made, if elsewhere
    condition : of camera and lens
    traceability : of the chart's scale: ruler, number of its certificate
    authoriser : name and function of the person who authorises the certificate
    signing_key : path of an Ed25519 private key, PEM
    """

    laboratory: str = ""
    laboratory_address: str = ""
    logo: str = ""
    accreditation: str = ""
    place: str = ""
    number: str = ""
    customer: str = ""
    customer_address: str = ""
    camera_serial: str = ""
    lens_serial: str = ""
    condition: str = ""
    received: str = ""
    issued: str = ""
    traceability: str = ""
    authoriser: str = ""
    signing_key: str = ""

    @classmethod
    def read(cls, path: Path | None = None) -> Self:
        """The details in a file; of certificate.toml in the current folder if there is one and no file is given. Raises
        BadParameter if the file, the logo or the signing key cannot be read, or a key or a value is not valid."""
        if path is None and not Path(DETAILS).is_file():
            return cls()
        given, source = TableSource.read(path or Path(DETAILS))
        details = read_model(cls, given, source)
        places = {}
        for key in ("logo", "signing_key"):
            if name := getattr(details, key):
                place = (path or Path(DETAILS)).parent / name
                if not place.is_file():
                    source.refuse((key,), f"names {printable(place)}, which does not exist", "correct its path")
                if key == "logo" and not _is_image(place):
                    source.refuse(
                        (key,), f"names {printable(place)}, which is no whole PNG or JPEG image", "export it again"
                    )
                places[key] = str(place)
        return replace(details, **places)

    @property
    def signer(self) -> str:
        """Who signs: authoriser and laboratory."""
        return printable(", ".join(one for one in (self.authoriser, self.laboratory) if one) or "unnamed")

    @property
    def lines(self) -> list[list[str]]:
        """Rows of the certificate: name and text of each detail that is given, except laboratory and authoriser."""
        named = {
            "Certificate number": self.number,
            "Customer": ", ".join(one for one in (self.customer, self.customer_address) if one),
            "Serial number of the camera": self.camera_serial,
            "Serial number of the lens": self.lens_serial,
            "Condition of the items": self.condition,
            "Received": self.received,
            "Issued": self.issued,
            "Place of the measurement": self.place,
            "Traceability of the scale": self.traceability,
        }
        if self.signing_key:
            named["Electronic signature"] = f"{ALGORITHM}, public key {public_key(Path(self.signing_key))}"
        return [[name, printable(text)] for name, text in named.items() if text]


def _is_image(path: Path) -> bool:
    """Whether a file is a PNG or JPEG image that can be drawn."""
    from PIL import Image  # here: it is slow to load

    try:
        with Image.open(path, formats=("PNG", "JPEG")) as image:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):  # by the kind of damage
        return False
    return True


def signature_files(files: Mapping[str, bytes], record: str, details: CertificateDetails) -> dict[str, bytes]:
    """Statement and signature of files, by name; nothing without a key. Raises BadInput."""
    if not details.signing_key:
        return {}
    key = Path(details.signing_key)
    head = {"signed by": details.signer, "public key": public_key(key), "record": record}
    statement = statement_of(files, head)
    return {STATEMENT: statement, SIGNATURE: sign(statement, key)}


def statement_of(files: Mapping[str, bytes], head: Mapping[str, str]) -> bytes:
    """Entries of a head and hashes of files, as `sha256sum --check` reads them."""
    lines = [f"# {name}: {words}" for name, words in head.items()]
    lines += [f"{hashlib.sha256(data).hexdigest()}  {name}" for name, data in files.items()]
    return "".join(f"{line}\n" for line in lines).encode()


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
