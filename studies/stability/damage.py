"""Random damage to files: to their bytes, and inside what JSON, zip, gzip and PNG pack them into.

Every damage takes a valid file's content and a generator, and gives other content; the same generator gives the same.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import gzip
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

Random = np.random.Generator
Damage = Callable[[bytes, Random], bytes]

#: What numbers in a text are replaced by.
NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"1e-320", b"99999999999999999999", b"2147483648", b"", b"x"),
    *(b"-2147483649", b"9223372036854775807", b"1e400", b"0x10", b"1_0", b"\xd9\xa3", b"1" * 5000),
)
#: What words of a binary file are replaced by: sizes, counts, infinities and NaN, of 2, 4 and 8 bytes, in both orders.
WORDS = (
    *(struct.pack("<I", v) for v in (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000, 0x7FC00000, 0x10000)),
    *(struct.pack(">I", v) for v in (1, 0x7FFFFFFF, 0x00010000, 0x10000000)),
    *(struct.pack("<Q", v) for v in (1, 2**31, 2**40, 2**62, 2**63, 2**64 - 1)),
    *(struct.pack("<d", v) for v in (float("nan"), float("inf"), -1.0, 1e308, 5e-324)),
    *(struct.pack("<H", v) for v in (0, 0x7FFF, 0x8000, 0xFFFF)),
)
#: What values of a JSON file are replaced by.
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 10**400, 1e308, "", "x", "../../x", "\x00", "a\nb", "\ud800", 2**63, -(2**63), 0.5),
    *([], {}, [[[]]], [None] * 3, {"x": {}}, float("nan"), float("inf"), "\u2028", "C:\\x", "/etc/passwd", "nan"),
)
#: Brackets in brackets.
_DEPTHS = (200, 5_000, 200_000)
#: Characters of a long text, and how often a list's entry is repeated.
_LONG, _MANY = 200_000, 3_000
_NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?")
#: Bytes that are no UTF-8, or that no text should hold.
_NO_TEXT = (b"\xff", b"\xfe\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\xf5\x80\x80\x80", b"\x00", b"\xe2\x80\xa8", b"\r")


def damaged(content: bytes, random: Random) -> bytes:
    """One random damage, or a few, to a file's content; to its values where it is JSON."""
    if content[:1] in (b"{", b"[") and random.random() < 0.7:
        with contextlib.suppress(ValueError):
            return _damaged_json(json.loads(content), random)
    for _ in range(int(random.choice([1, 1, 1, 2, 5]))):
        content = _pick(_DAMAGES, random)(content, random)
    return content


def _pick(of: Any, random: Random) -> Any:
    return of[int(random.integers(len(of)))]


def _flipped(content: bytes, random: Random) -> bytes:
    out = bytearray(content)
    for at in random.integers(0, max(1, len(out)), int(random.choice([1, 2, 8, 64]))):
        if out:
            out[at % len(out)] ^= 1 << int(random.integers(8))
    return bytes(out)


def _cut(content: bytes, random: Random) -> bytes:
    return content[: int(random.integers(0, len(content) + 1))]


def _removed(content: bytes, random: Random) -> bytes:
    at, length = int(random.integers(0, len(content) + 1)), int(random.choice([1, 2, 4, 50, 1000]))
    return content[:at] + content[at + length :]


def _inserted(content: bytes, random: Random) -> bytes:
    at, length = int(random.integers(0, len(content) + 1)), int(random.choice([1, 4, 50, 3000]))
    extra = random.bytes(length) if random.random() < 0.5 else content[at : at + length] * 2
    return content[:at] + extra + content[at:]


def _number(content: bytes, random: Random) -> bytes:
    found = list(_NUMBER.finditer(content[:20000]))
    if not found:
        return _word(content, random)
    hit = _pick(found, random)
    return content[: hit.start()] + _pick(NUMBERS, random) + content[hit.end() :]


def _place(content: bytes, random: Random) -> int:
    # Headers decide most: half of the places are among the first hundred bytes.
    end = min(len(content), 100) if random.random() < 0.5 else len(content)
    return int(random.integers(0, max(1, end)))


def _word(content: bytes, random: Random) -> bytes:
    at, word = _place(content, random), _pick(WORDS, random)
    return content[:at] + word + content[at + len(word) :]


def _swapped(content: bytes, random: Random) -> bytes:
    """Two neighbouring or distant words change places, such as a width and a height, a count and a size."""
    size = int(random.choice([1, 2, 4, 8]))
    first = _place(content, random)
    second = first + size if random.random() < 0.5 else _place(content, random)
    first, second = min(first, second), max(first, second)
    if second < first + size:
        return content
    middle = content[first + size : second]
    return (
        content[:first]
        + content[second : second + size]
        + middle
        + content[first : first + size]
        + content[second + size :]
    )


def _spliced(content: bytes, random: Random) -> bytes:
    """The beginning of one file, and the end of another that begins elsewhere."""
    first, second = (int(at) for at in random.integers(0, len(content) + 1, 2))
    return content[:first] + content[second:]


def _no_text(content: bytes, random: Random) -> bytes:
    at = _place(content, random)
    return content[:at] + _pick(_NO_TEXT, random) + content[at + int(random.integers(2)) :]


def _long(content: bytes, random: Random) -> bytes:
    """A long word or line."""
    at, letter = _place(content, random), _pick((b"a", b"9", b" ", b"\n", b"[", b"a ", b"1 "), random)
    return content[:at] + letter * (_LONG // len(letter)) + content[at:]


def _lines(content: bytes, random: Random) -> bytes:
    """A line twice, gone, or elsewhere."""
    lines = content.split(b"\n")
    line = lines.pop(int(random.integers(len(lines))))
    for _ in range(int(random.integers(3))):
        lines.insert(int(random.integers(len(lines) + 1)), line)
    return b"\n".join(lines)


_DAMAGES: tuple[Damage, ...] = (
    *(_flipped, _cut, _removed, _inserted, _number, _number, _word, _word),
    *(_swapped, _spliced, _no_text, _lines, _long),
)


# --- JSON -----------------------------------------------------------------------------------------------------------


def _damaged_json(value: Any, random: Random) -> bytes:
    places: list[tuple[Any, Any]] = []

    def collect(node: Any) -> None:
        for key in node if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], (dict, list)):
                collect(node[key])

    if isinstance(value, (dict, list)):
        collect(value)
    if not places or random.random() < 0.02:
        return _dumped(_pick(VALUES, random))
    for _ in range(int(random.choice([1, 1, 1, 2]))):
        node, key = _pick(places, random)
        if isinstance(node, list) and not isinstance(key, str) and key >= len(node):
            continue
        if isinstance(node, dict) and key not in node:
            continue
        if random.random() < 0.05:
            return _with_text(value, node, key, random)
        _pick(_JSON_DAMAGES, random)(node, key, places, random)
    return _dumped(value)


def _dumped(value: Any) -> bytes:
    return json.dumps(value).encode("utf-8", "surrogatepass")


def _other(node: Any, key: Any, _places: Any, random: Random) -> None:
    node[key] = copy.deepcopy(_pick(VALUES, random))


def _gone(node: Any, key: Any, _places: Any, _random: Random) -> None:
    del node[key]


def _exchanged(node: Any, key: Any, places: Any, random: Random) -> None:
    """Of two values, in any part of the file."""
    other, there = _pick(places, random)
    try:
        value = copy.deepcopy(other[there])
        other[there] = copy.deepcopy(node[key])
    except (KeyError, IndexError, RecursionError):  # one of them is gone, or lies in the other
        return
    node[key] = value


def _renamed(node: Any, key: Any, _places: Any, random: Random) -> None:
    if isinstance(node, dict):
        node[str(_pick(("", "*", "\x00", "x" * 100, "../../x", f"{key}?", str(key).upper()), random))] = node.pop(key)


def _repeated(node: Any, key: Any, _places: Any, _random: Random) -> None:
    some = node[key] if isinstance(node[key], list) else [node[key]]
    if len(str(some)[:10_000]) < 10_000:
        node[key] = (some * _MANY)[:_MANY]


def _lengthened(node: Any, key: Any, _places: Any, random: Random) -> None:
    some = str(node[key])[:40] or "a"
    node[key] = some * (_LONG // len(some)) if random.random() < 0.5 else "9" * _LONG


_JSON_DAMAGES: tuple[Callable[[Any, Any, Any, Random], None], ...] = (
    *(_other, _other, _other, _other, _gone, _gone, _exchanged, _renamed, _repeated, _lengthened),
)


def _with_text(value: Any, node: Any, key: Any, random: Random) -> bytes:
    """What no value is written as: brackets without end, a key twice, a number of thousands of digits."""
    depth = int(random.choice(_DEPTHS))
    texts = (
        b"[" * depth + b"]" * depth,
        b'{"a":' * depth + b"1" + b"}" * depth,
        b"-" + b"9" * 5000,
        b"1e999999",
        b"'x'",
    )
    mark = "\x01here"
    if isinstance(node, dict) and random.random() < 0.3:
        node[mark] = copy.deepcopy(_pick(VALUES, random))
        return _dumped(value).replace(_dumped(mark), _dumped(key))
    node[key] = mark
    return _dumped(value).replace(_dumped(mark), _pick(texts, random))


# --- What files are packed into -------------------------------------------------------------------------------------


@functools.cache
def _zeros() -> bytes:
    """16 MiB of zeros, packed by gzip into 16 kB."""
    return gzip.compress(bytes(2**24), 9, mtime=0)


def inside_gzip(content: bytes, random: Random) -> bytes:
    """Of the packed bytes, of what they unpack to, or a bomb of 2 GiB."""
    chance = random.random()
    if chance < 0.3:
        return damaged(content, random)
    if chance < 0.32:
        return _zeros() * 128 if random.random() < 0.5 else content + _zeros() * 128
    return gzip.compress(damaged(gzip.decompress(content), random), 1)


def inside_npz(content: bytes, random: Random) -> bytes:
    """Arrays of another length, kind or shape, gone or renamed; headers that lie; a facts text that is damaged."""
    chance = random.random()
    if chance < 0.15:
        return damaged(content, random)
    if chance < 0.3:
        return _zip_lies(content, random)
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if "__facts__" in arrays and random.random() < 0.4:
        arrays["__facts__"] = np.frombuffer(damaged(arrays["__facts__"].tobytes(), random), np.uint8)
        return _npz({name: _npy(array) for name, array in arrays.items()})
    name = _pick(sorted(name for name, array in arrays.items() if array.ndim), random)
    files = {key: _npy(array) for key, array in arrays.items()}
    if random.random() < 0.3:
        files[name] = lying_npy(files[name], random)
    else:
        changed = _changed(arrays[name], int(random.integers(_CHANGES)))
        if changed is None:
            del files[name]
        else:
            files[name] = _npy(changed)
    return _npz(files)


def _npy(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


def _npz(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            archive.writestr(f"{name}.npy", data)
    return out.getvalue()


#: How `_changed` changes an array.
_CHANGES = 13


def _changed(array: np.ndarray, how: int) -> np.ndarray | None:
    """Of another length, shape, kind or content; None to leave it out."""
    flat = array.reshape(-1)
    return (
        None,
        array[:-1],
        array[:0],
        array.astype(np.float64),
        array.astype(np.int16),
        np.repeat(array, 2, axis=0),
        flat.reshape(1, -1),
        np.full_like(array, 255 if array.dtype.kind == "u" else np.nan),
        array.astype(">f4"),
        array.astype("U8"),
        array.astype(np.complex64),
        np.asfortranarray(array)[..., ::-1],
        np.full_like(array, 1 if array.dtype.kind in "uU" else -3e38),
    )[how]


#: Headers of .npy files that lie about shape or kind.
_LIES = (
    *(b"(1099511627776,)", b"(-1,)", b"(4294967296, 4294967296)", b"(True,)", b"((1,),)", b"(1.5,)", b"()", b"(0,)"),
    *(b"('a',)", b"(" + b"1," * 200 + b")", b"(9" + b"9" * 400 + b",)"),
)
_KINDS = (
    b"'|O'",
    b"'<U1000000000'",
    b"'|V8'",
    b"[('a', '<f4')]",
    b"'<f2'",
    b"'>i8'",
    b"'x'",
    b"3",
    b"'<M8[s]'",
    b"'|S0'",
)


def lying_npy(content: bytes, random: Random) -> bytes:
    """One array whose header says something else."""
    begin = 10
    length = struct.unpack_from("<H", content, 8)[0]
    header, data = content[begin : begin + length], content[begin + length :]
    key, lies = (b"'shape'", _LIES) if random.random() < 0.5 else (b"'descr'", _KINDS)
    pattern = rb"\([^)]*\)" if key == b"'shape'" else rb"'[^']*'"
    lie = _pick(lies, random)
    header = re.sub(key + rb": " + pattern, lambda _: key + b": " + lie, header, count=1)
    return content[:8] + struct.pack("<H", len(header)) + header + data


def damaged_npy(content: bytes, random: Random) -> bytes:
    """A .npy file: its bytes, or what its header says."""
    return lying_npy(content, random) if random.random() < 0.4 else damaged(content, random)


def _zip_lies(content: bytes, random: Random) -> bytes:
    """Sizes, names and packing of an archive's entries are not what they seem."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    out, victim, how = io.BytesIO(), _pick(sorted(files), random), int(random.integers(5))
    names = (
        "../../escaped.npy",
        "/tmp/escaped.npy",
        "",
        "a" * 5000,
        "\\x.npy",
        "__facts__",
        victim,
        "a/b.npy",
        "a\0.npy",
    )
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            other = str(_pick(names, random)) if how == 0 and name == victim else name
            packing = zipfile.ZIP_DEFLATED if how == 1 and name == victim else zipfile.ZIP_STORED
            bomb = how == 1 and name == victim and random.random() < 0.3
            with contextlib.suppress(UserWarning):
                archive.writestr(zipfile.ZipInfo(other), bytes(2**24) if bomb else data, packing)
        if how == 2:
            archive.writestr(zipfile.ZipInfo(str(_pick(names, random))), files[victim])
    result = bytearray(out.getvalue())
    if how in (3, 4):  # sizes in the local headers, or in the directory at the end
        mark, at = (b"PK\x03\x04", 18) if how == 3 else (b"PK\x01\x02", 20)
        places = [hit.start() for hit in re.finditer(re.escape(mark), bytes(result))]
        place = int(_pick(places, random)) + at + int(random.choice([0, 4]))
        result[place : place + 4] = struct.pack("<I", int(_pick((0, 1, 2**31, 2**32 - 16, 2**32 - 1, 10**6), random)))
    return bytes(result)


def inside_png(content: bytes, random: Random) -> bytes:
    """One chunk is changed, its length and checksum fit: of pixels what is packed, or what it unpacks to."""
    if random.random() < 0.2:
        return damaged(content, random)
    chunks, at = list[tuple[bytes, bytes]](), 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    chosen = int(random.integers(len(chunks)))
    kind, data = chunks[chosen]
    chance = random.random()
    if chance < 0.1:
        chunks.insert(chosen, (_pick((b"iCCP", b"zTXt", b"tRNS", b"PLTE", b"eXIf", b"IDAT", b"acTL"), random), data))
    elif kind == b"IHDR" and chance < 0.5:
        sides = (0, 1, 2**31 - 1, 2**32 - 1, 16384, 100_000)
        chunks[chosen] = kind, struct.pack(">II", int(_pick(sides, random)), int(_pick(sides, random))) + data[8:]
    elif kind == b"IDAT" and chance < 0.5:
        chunks[chosen] = kind, zlib.compress(damaged(zlib.decompress(data), random))
    else:
        chunks[chosen] = kind, damaged(data, random)
    return png(chunks)


def png(chunks: Iterable[tuple[bytes, bytes]]) -> bytes:
    """A PNG file of (kind, data), with lengths and checksums."""
    packed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)
