"""What may become of a file in a text editor, on a bad disk, or in hands that mean harm."""

import re
import string

import numpy as np

LETTERS = string.printable.encode() + b"\x00\xff\x80"
VALUE = re.compile(rb'"(?:[^"\\\n]|\\.)*"|[-+.\w]+')
MARK = re.compile(rb"[\[\]{}<>:=,/]")
VALUES = (
    *(b"null", b"true", b"0", b"-1", b"1", b"0.5", b"3", b"1e308", b"-1e308", b"1e-308", b"-0.0e999", b"1e9"),
    *(
        b"65536",
        b"9223372036854775808",
        b"9" * 300,
        b'""',
        b'"x"',
        b'"1"',
        rb'"\u0000"',
        b'"%s"' % (b"x" * 5000),
    ),
    *(
        b"[]",
        b"{}",
        b"[1]",
        b"[[1]]",
        b'{"a": 1}',
        b'["x"]',
        b"[" * 40 + b"]" * 40,
        b"[%s1]" % (b"1," * 2000),
    ),
)
"""Such as JSON has."""
RUBBISH = (
    *(b"1e400", b"NaN", b"-Infinity", b"nan", b"inf", b"1" * 5000, rb'"\ud800"', b"'x'", b"x", b"2021-01-01"),
    *(b"[" * 200, b"[" * 5000, b'{"a":' * 5000, b"\xff\xfe", b"\x00", b"<!--", b"&a;", b"*a", b"&a", b"\n"),
)


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three changes: a value or mark replaced, left out, repeated or exchanged; bytes cut out or put in."""
    for _ in range(int(rng.choice(3, p=(0.7, 0.2, 0.1))) + 1):
        content = _changed(content, rng)
    return content


def _changed(content: bytes, rng: np.random.Generator) -> bytes:
    if rng.random() < 0.15:
        return _damaged(content, rng)
    tokens = list((VALUE if rng.random() < 0.9 else MARK).finditer(content[:200_000]))
    if not tokens:
        return VALUES[rng.integers(len(VALUES))]
    first, other = (tokens[i] for i in rng.integers(len(tokens), size=2))
    values = VALUES if rng.random() < 0.8 else RUBBISH
    changes = (b"", first[0] + b" " + first[0], other[0], *[values[rng.integers(len(values))]] * 4)
    return content[: first.start()] + changes[rng.integers(len(changes))] + content[first.end() :]


def _damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Without regard to what it is."""
    start, end = sorted(rng.integers(len(content) + 1, size=2))
    kind = rng.integers(5)
    if kind == 0:
        return content[:start]
    if kind == 1:
        return content[:start] + content[min(end, start + 40) :]
    if kind == 2:
        return content[:end] + content[start : start + 400] + content[end:]
    some = rng.choice(np.frombuffer(LETTERS, np.uint8), int(rng.integers(1, 5)))
    return content[:start] + some.tobytes() + content[start + len(some) * int(kind == 3) :]
