"""Signatures of evidence: a DSSE envelope (https://github.com/secure-systems-lab/dsse, v1.0) with one Ed25519 key."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

import orjson

from valerie.errors import Conflict, InvalidInput, StorageUnavailable
from valerie.pipeline.evidence.evidence_manifest import SIGNED, Refused, document_bytes

if TYPE_CHECKING:
    from securesystemslib.dsse import Envelope
    from securesystemslib.signer import CryptoSigner, SSlibKey

#: Media type of the signed statement.
PAYLOAD_TYPE: Final = "application/vnd.in-toto+json"
_MAX_KEY_BYTES: Final = 16_384


def new_key(path: Path) -> str:
    """Create a key pair, ``path`` (PKCS #8, PEM, readable only by its owner) and ``path.pub`` (PEM); return the key's id.

    Raises:
        Conflict: one of the files exists.
        StorageUnavailable: they cannot be written.
    """
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key
    from securesystemslib.signer import CryptoSigner

    signer = CryptoSigner.generate_ed25519()
    private = signer.private_bytes
    public_key = load_pem_private_key(private, None).public_key()
    public = public_key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    public_path = path.with_name(path.name + ".pub")
    for file in (path, public_path):
        if file.exists() or file.is_symlink():
            raise Conflict(f"{file} exists already; a key is never replaced")
    for file, data, mode in ((path, private, 0o600), (public_path, public, 0o644)):
        try:
            with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as stream:
                stream.write(data)
        except OSError as error:
            raise StorageUnavailable(f"{file} cannot be written: {error.strerror}") from error
    return str(signer.public_key.keyid)


def read_private_key(path: Path) -> CryptoSigner:
    """Read the private key of `new_key`.

    Raises:
        InvalidInput: the file cannot be read, or contains no Ed25519 key without a password.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key
    from securesystemslib.signer import CryptoSigner

    try:
        key = load_pem_private_key(_key_bytes(path), None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        raise InvalidInput(
            "not a private Ed25519 key", field="--key", value=str(path), limit="PEM, as `valerie evidence key new`"
        )
    return CryptoSigner(key)


def read_public_key(path: Path) -> SSlibKey:
    """Read the public key of `new_key`.

    Raises:
        InvalidInput: the file cannot be read, or contains no public Ed25519 key.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key
    from securesystemslib.signer import SSlibKey

    try:
        key = load_pem_public_key(_key_bytes(path))
    except (ValueError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PublicKey):
        raise InvalidInput(
            "not a public Ed25519 key", field="--key", value=str(path), limit="the file .pub beside the private key"
        )
    return SSlibKey.from_crypto(key)


def _key_bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_MAX_KEY_BYTES)
    except OSError as error:
        raise InvalidInput(f"the key cannot be read ({error.strerror})", field="--key", value=str(path)) from error


def sign(payload: bytes, signer: CryptoSigner) -> bytes:
    """Return a statement in a signed envelope; equal payloads and keys give equal bytes."""
    from securesystemslib.dsse import Envelope

    envelope = Envelope(payload, PAYLOAD_TYPE, {})
    envelope.sign(signer)
    return document_bytes(envelope.to_dict())


def require_envelope(data: bytes, payload: bytes) -> Envelope:
    """Read an envelope of this payload; its signature is not checked.

    Raises:
        Refused: not an envelope that `sign` writes, or one of another payload.
    """
    from securesystemslib.dsse import Envelope

    try:
        envelope = Envelope.from_dict(orjson.loads(data))
        spelled = document_bytes(envelope.to_dict())
    except Exception as error:  # the library checks no types
        raise Refused([f"{SIGNED}: not a DSSE envelope"]) from error
    if spelled != data or envelope.payload_type != PAYLOAD_TYPE or len(envelope.signatures) != 1:
        raise Refused([f"{SIGNED}: not an envelope with one signature as VALERIE writes it"])
    if envelope.payload != payload:
        raise Refused([f"{SIGNED}: it signs another manifest"])
    return envelope


def require_signature(envelope: Envelope, key: SSlibKey) -> str:
    """Check the signature of an envelope; return the key's id.

    Raises:
        Refused: this key did not sign it.
    """
    from securesystemslib.exceptions import VerificationError

    try:
        envelope.verify([key], 1)
    except VerificationError:
        raise Refused([f"{SIGNED}: not signed by the key {key.keyid[:16]}…"]) from None
    return str(key.keyid)
