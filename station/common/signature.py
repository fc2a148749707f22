"""Ed25519 signatures (RFC 8032): keys in PEM files, signing, and checks of what was signed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procedures.outcome import BadInput
from station.common.sanitise import printable

ALGORITHM = "Ed25519"


@dataclass(frozen=True)
class ProofCheck:
    """One check: what was compared, whether it agrees (None if it could not be compared), and a sentence."""

    name: str
    agrees: bool | None
    words: str


AGREES = {True: "ok", False: "DIFFERS", None: "not compared"}


def _cryptography() -> Any:
    """The parts of cryptography in use. Raises BadInput if it is not installed."""
    try:
        from cryptography import exceptions
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError as error:
        raise BadInput(
            "a signature needs cryptography, which is not installed",
            "install it: pip install 'calibration-station[sign]', or continue without a key",
        ) from error
    return ed25519, serialization, exceptions


def create_key(path: Path) -> None:
    """Write a new private key, which only its owner can read, and its public key beside it as `.pub`."""
    ed25519, serialization, _ = _cryptography()
    key = ed25519.Ed25519PrivateKey.generate()
    pem = serialization.Encoding.PEM
    path.touch(mode=0o600, exist_ok=False)
    path.write_bytes(key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()))
    public = key.public_key().public_bytes(pem, serialization.PublicFormat.SubjectPublicKeyInfo)
    path.with_suffix(".pub").write_bytes(public)


def _key(path: Path) -> Any:
    """The private key of a file. Raises BadInput."""
    ed25519, serialization, _ = _cryptography()
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        raise BadInput(f"{path} is no private key without password: {error}", "name an Ed25519 key") from error
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise BadInput(f"{path} holds another kind of key", "name an Ed25519 key, or a file that is to be created")
    return key


def public_key(path: Path) -> str:
    """The public key of a file with a private or a public key, in hexadecimal digits. Raises BadInput."""
    ed25519, serialization, _ = _cryptography()
    try:
        key = serialization.load_pem_public_key(path.read_bytes())
    except (OSError, ValueError):
        key = _key(path).public_key()
    if not isinstance(key, ed25519.Ed25519PublicKey):
        raise BadInput(f"{path} holds another kind of key", "name an Ed25519 key")
    return str(key.public_bytes_raw().hex())


def sign(data: bytes, path: Path) -> bytes:
    """The signature of data with the private key of a file. Raises BadInput."""
    return bytes(_key(path).sign(data))


def check_signature(data: bytes, signature: bytes, public: str, signer: Path | None, name: str = "") -> ProofCheck:
    """Whether a signature is of data by a public key, and by that of `signer` if given; `name` is the stated signer."""
    ed25519, _, exceptions = _cryptography()
    try:
        ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(public)).verify(signature, data)
    except (exceptions.InvalidSignature, ValueError):
        return ProofCheck("signature", False, "the signature is not that of this content")
    by = f"signed by {printable(name)} " if name else "signed "
    if signer is None:
        return ProofCheck("signature", True, f"{by}with the key {public}, which is compared with no known one")
    keys = sorted(signer.glob("*.pub")) if signer.is_dir() else [signer]
    known = next((key for key in keys if public_key(key) == public), None)
    if known is None:
        return ProofCheck("signature", False, f"it is signed with another key, {public}")
    return ProofCheck("signature", True, f"{by}with the key of {printable(known)}")


def signature_entry(digest: str, path: Path) -> dict[str, str]:
    """The signature of a digest as entry of a record. Raises BadInput."""
    return {"algorithm": ALGORITHM, "public_key": public_key(path), "value": sign(digest.encode(), path).hex()}


def check_entry(entry: Mapping[str, str] | None, digest: str, signer: Path | None) -> ProofCheck:
    """The check of a record's entry; without one, nothing is compared unless a signer is expected."""
    if not entry:
        return ProofCheck("signature", None if signer is None else False, "the record is not signed")
    return check_signature(digest.encode(), bytes.fromhex(entry["value"]), entry["public_key"], signer)
