"""Details of a certificate that no photograph holds: laboratory, customer, serial numbers, dates, authoriser.

```toml
laboratory = "Optics laboratory"
logo = "logo.png"                   # beside this file
number = "2026-0117"
customer = "Example Ltd"
lens_serial = "1234567"
```
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from station.common.models import TableSource, read_model
from station.common.sanitise import printable

DETAILS = "certificate.toml"
"""Name of the file that is used if none is given."""


@dataclass(frozen=True)
class CertificateDetails:
    """Details required by ISO/IEC 17025:2017, section 7.8.2, that a record does not hold.

    Attributes
    ----------
    logo : path of a PNG or JPEG image
    traceability : of the chart's scale: ruler, number of its certificate
    authoriser : name and function of the person who authorises the certificate
    """

    laboratory: str = ""
    laboratory_address: str = ""
    logo: str = ""
    accreditation: str = ""
    number: str = ""
    customer: str = ""
    customer_address: str = ""
    camera_serial: str = ""
    lens_serial: str = ""
    received: str = ""
    issued: str = ""
    traceability: str = ""
    authoriser: str = ""

    @classmethod
    def read(cls, path: Path | None = None) -> Self:
        """The details in a file; of certificate.toml in the current folder if there is one and no file is given.

        Raises
        ------
        BadParameter
            If the file or the logo cannot be read, or a key or a value is not valid.
        """
        if path is None and not Path(DETAILS).is_file():
            return cls()
        given, source = TableSource.read(path or Path(DETAILS))
        details = read_model(cls, given, source)
        if not details.logo:
            return details
        logo = (path or Path(DETAILS)).parent / details.logo
        if not logo.is_file():
            source.refuse(("logo",), f"names {printable(logo)}, which does not exist", "correct its path")
        return replace(details, logo=str(logo))

    @property
    def lines(self) -> list[list[str]]:
        """Rows of the certificate: name and text of each detail that is given, except laboratory and authoriser."""
        named = {
            "Certificate number": self.number,
            "Customer": ", ".join(one for one in (self.customer, self.customer_address) if one),
            "Serial number of the camera": self.camera_serial,
            "Serial number of the lens": self.lens_serial,
            "Received": self.received,
            "Issued": self.issued,
            "Traceability of the scale": self.traceability,
        }
        return [[name, printable(text)] for name, text in named.items() if text]
