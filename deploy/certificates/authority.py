"""The certificate authority of a fleet's Zenoh links: a folder, managed with OpenSSL."""

import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

AUTHORITY_DAYS, DAYS, RENEWED_DAYS = 3650, 397, 30
_DAY_S = 86_400
_HOST = re.compile(r"(DNS|IP Address):([^,\s]+)")


class CertificateError(Exception):
    """OpenSSL is missing or failed; the message is its output."""


@dataclass(frozen=True)
class CertificateAuthority:
    """The authority in a folder; existing files are kept."""

    folder: Path

    def create(self) -> None:
        """Create the authority's own certificate."""
        certificate = self.folder / "ca.pem"
        if certificate.exists():
            return
        key = self._key("ca")
        extensions = ("basicConstraints=critical,CA:TRUE,pathlen:0", "keyUsage=critical,keyCertSign,cRLSign")
        words = ("req", "-x509", "-new", "-sha256", "-subj", "/CN=Linked Fleet wire", "-days", str(AUTHORITY_DAYS))
        options = [word for extension in extensions for word in ("-addext", extension)]
        _openssl(*words, "-key", str(key), *options, "-out", str(certificate))
        print(f"{certificate}: made, valid for {AUTHORITY_DAYS} days")

    def certify(self, stem: str, name: str, hosts: Sequence[str] = ()) -> None:
        """Create a certificate for connecting and, for each of ``hosts``, for listening.

        An existing certificate is kept if it is valid for another month and has these hosts; its key is always kept.
        """
        certificate = self.folder / f"{stem}.pem"
        if certificate.exists() and _lasts(certificate) and all(_is_of(certificate, host) for host in hosts):
            return
        key = self._key(stem)
        with tempfile.TemporaryDirectory() as folder:
            request, extensions, made = (Path(folder) / each for each in ("request", "extensions", "made"))
            extensions.write_text(_extensions(hosts))
            _openssl("req", "-new", "-key", str(key), "-subj", f"/CN={name}", "-out", str(request))
            ca = ("-CA", str(self.folder / "ca.pem"), "-CAkey", str(self.folder / "ca.key"), "-CAcreateserial")
            words = ("-req", "-sha256", "-days", str(DAYS), *ca, "-extfile", str(extensions))
            _openssl("x509", *words, "-in", str(request), "-out", str(made))
            certificate.write_bytes(made.read_bytes())
        print(f"{certificate}: made, valid for {DAYS} days")

    def hosts(self, stem: str) -> tuple[str, ...]:
        """Return the names and addresses of an existing certificate; empty if there is none."""
        certificate = self.folder / f"{stem}.pem"
        if not certificate.exists():
            return ()
        said = _openssl("x509", "-in", str(certificate), "-noout", "-ext", "subjectAltName", fails=True)
        return tuple(host for _, host in _HOST.findall(said))

    def _key(self, where: str) -> Path:
        """Create a key that only its owner can ever read."""
        key = self.folder / f"{where}.key"
        if not key.exists():
            key.parent.mkdir(parents=True, exist_ok=True)
            key.touch(mode=0o600)
            key.write_text(_openssl("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256"))
        return key


def _extensions(hosts: Sequence[str]) -> str:
    usages = "clientAuth, serverAuth" if hosts else "clientAuth"
    lines = ["basicConstraints = critical, CA:FALSE", f"extendedKeyUsage = {usages}"]
    names = ", ".join(("IP:" if _is_address(host) else "DNS:") + host for host in hosts)
    return "\n".join([*lines, *([f"subjectAltName = {names}"] if hosts else [])]) + "\n"


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _lasts(certificate: Path) -> bool:
    said = _openssl("x509", "-in", str(certificate), "-noout", "-checkend", str(RENEWED_DAYS * _DAY_S), fails=True)
    return "will not expire" in said


def _is_of(certificate: Path, host: str) -> bool:
    check = "-checkip" if _is_address(host) else "-checkhost"
    return "does match" in _openssl("x509", "-in", str(certificate), "-noout", check, host)


def _openssl(*words: str, fails: bool = False) -> str:
    """Return the output; CertificateError on failure unless ``fails`` permits it."""
    try:
        done = subprocess.run(("openssl", *words), capture_output=True, text=True, check=False)  # noqa: S603, S607
    except OSError as error:
        raise CertificateError(f"openssl cannot be run: {error.strerror}") from error
    if done.returncode and not fails:
        raise CertificateError(f"openssl {words[0]}: {done.stderr.strip()}")
    return done.stdout
