"""Task files that nobody would write: spoiled bytes, words, numbers and structure, by the thousand.

The law: a file is refused with `BadInput` that says where, or it is a valid task that is written and read
back the same. Never another exception, never slow, never big.
"""

from __future__ import annotations

import random
import re
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

from vita.errors import BadInput
from vita.fuzz.base import Report
from vita.scenario.emit import document
from vita.scenario.library import shipped
from vita.scenario.seal import sealed
from vita.scenario.toml_io import dumps, loads, parse

SLOW_S, BIG_BYTES = 0.25, 20_000_000
"""More of the processor's time than this for one file is a violation, and so is more memory."""
WEIGH_EVERY = 25
"""Memory is measured for every so many files, because measuring it takes five times as long."""
_WHERE = re.compile(r"line \d|end of document|larger than|nested too deeply|times the sign|cannot be read")
"""How a message says where, other than by a path."""
_TOKEN = re.compile(r'"[^"\n]*"|[A-Za-z_][\w-]*|-?\d[\d.e+-]*|[\[\]{}=,.]|\n')
_NUMBER = re.compile(r"(?<![\w\"])-?\d+(?:\.\d+)?(?:e-?\d+)?")
_WORDS = (
    "nan", "inf", "-inf", "+nan", "1e200", "1e-320", "-0.0", "0x7f", "0b1", "9" * 400, "1_000", "true",
    "false", '""', '"a"', '"../../x"', '"<b>x</b>"', '"\\u0000"', '"\\ud800"', "'''", '"""', "1979-05-27",
    "07:32:00", "1979-05-27T07:32:00Z", "[]", "{}", "[[]]", "[" * 40, "]" * 40, "{ a = {} }", "=", ",", ".",
    "#", "\n", "\r", "\t", "\0", "\ufeff", "\u202e", "schema", "x-a", "name", "tracker", "[[tracker]]", "64",
    "[servo]", "-1",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 2**63, 10**30, 0.0, -0.0, 1e200, float("nan"), float("inf"), "", "a", "x" * 5000,
    "a\0b", [], {}, [[]], [{}], [1, "a"], [0.0, 0.0], [0.0, 0.0, 0.0], {"a": 1}, [None], "left", "../x",
)  # fmt: skip


def run(seconds: float, seed: int) -> Report:
    """Spoil files for so long."""
    chance = random.Random(seed)
    texts = [path.read_text(encoding="utf-8") for path in shipped().values()]
    texts += [sealed(dumps(loads(text))) for text in texts]
    tried = accepted = 0
    slowest_s, biggest = 0.0, 0
    violations: list[str] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        spoil = chance.choice(WAYS)
        data = spoil(chance, chance.choice(texts))
        weigh = tried % WEIGH_EVERY == 0
        if weigh:
            tracemalloc.start()
        started = time.process_time()
        good, wrong = judge(data)
        if weigh:
            biggest = max(biggest, tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        else:
            took_s = time.process_time() - started
            slowest_s = max(slowest_s, took_s)
            if took_s > SLOW_S:
                wrong = f"took {took_s:.2f} s"
        if biggest > BIG_BYTES:
            wrong, biggest = f"took {biggest / 1e6:.0f} MB", 0
        if wrong:
            violations.append(f"{spoil.__name__}, seed {seed}, file {tried}: {wrong}; {data[:2000]!r}")
        tried += 1
        accepted += good
    figures = {
        "accepted": float(accepted), "slowest [ms]": 1e3 * slowest_s, "most memory [MB]": biggest / 1e6,
        "per second": tried / seconds,
    }  # fmt: skip
    return Report("files", tried, "files", tuple(violations), figures)


def judge(data: bytes) -> tuple[bool, str]:
    """Whether a file is accepted, and what is wrong with how it was dealt with; empty when nothing is."""
    try:
        scenario = loads(data, "file")
    except BadInput as refusal:
        message = str(refusal)
        if len(message) > 2000:
            return False, f"a message of {len(message)} characters"
        return False, "" if refusal.path or _WHERE.search(message) else f"does not say where: {message}"
    except Exception as error:
        return False, f"{type(error).__name__}: {str(error)[:200]}"
    try:
        return True, "" if loads(dumps(scenario)) == scenario else "is not read back the same"
    except Exception as error:
        return True, f"is accepted but cannot be saved: {type(error).__name__}: {str(error)[:200]}"


# Ways to spoil a file ------------------------------------------------------------------------------


def spoil_bytes(chance: random.Random, text: str) -> bytes:
    """Bits flipped, pieces cut, doubled or moved, rubbish put in."""
    data = bytearray(text.encode())
    for _ in range(chance.choice((1, 1, 2, 8))):
        at = chance.randrange(len(data) + 1)
        piece = data[at : at + chance.choice((1, 1, 4, 40, 400))]
        match chance.randrange(6):
            case 0 if at < len(data):
                data[at] ^= 1 << chance.randrange(8)
            case 1:
                del data[at : at + len(piece)]
            case 2:
                data[at:at] = piece * chance.choice((1, 2, 50))
            case 3:
                data[at:at] = chance.randbytes(chance.choice((1, 3, 30)))
            case 4:
                del data[at:]
            case _:
                other = chance.randrange(len(data) + 1)
                data[other:other] = piece
    return bytes(data[:300_000])


def spoil_words(chance: random.Random, text: str) -> bytes:
    """Words of the file in each other's places, and words that it never had."""
    words = _TOKEN.findall(text)
    gaps = _TOKEN.split(text)
    for _ in range(chance.choice((1, 1, 2, 5))):
        at = chance.randrange(len(words))
        words[at] = chance.choice(_WORDS) if chance.random() < 0.5 else chance.choice(words)
    mixed = "".join(gap + word for gap, word in zip(gaps, [*words, ""], strict=True))
    return mixed.encode("utf-8", "replace")


def spoil_numbers(chance: random.Random, text: str) -> bytes:
    """Numbers far too big, too small, or none."""
    places = list(_NUMBER.finditer(text))
    chosen = chance.sample(places, min(len(places), chance.choice((1, 1, 3))))
    for match in sorted(chosen, key=lambda m: -m.start()):  # from the end, so that places stay right
        text = text[: match.start()] + _number(chance, match[0]) + text[match.end() :]
    return text.encode()


def _number(chance: random.Random, old: str) -> str:
    if chance.random() < 0.4:
        return chance.choice(_WORDS[:12])
    factor = chance.choice((-1.0, 0.0, 0.5, 2.0, 10.0, 1e3, 1e6, 1e-9))
    value = float(old) * factor
    return repr(round(value)) if "." not in old and chance.random() < 0.7 else repr(value)


def spoil_structure(chance: random.Random, text: str) -> bytes:
    """Keys lost, doubled, renamed or filled with something else; lists stretched and emptied."""
    table: Any = parse(text)
    for _ in range(chance.choice((1, 1, 2, 4))):
        _twist(chance, table)
    return sealed(document(_writable(table))).encode("utf-8", "replace")


def _twist(chance: random.Random, table: Any) -> None:
    """One change somewhere in a tree of tables and lists, in place."""
    inner = [node for node in _nodes(table) if node]
    if not inner:
        return
    node = chance.choice(inner)
    keys = list(node) if isinstance(node, dict) else list(range(len(node)))
    key, other = chance.choice(keys), chance.choice(keys)
    match chance.randrange(6):
        case 0:
            del node[key]
        case 1:
            node[key] = chance.choice(_VALUES)
        case 2:
            node[key], node[other] = node[other], node[key]
        case 3 if isinstance(node, dict):
            node[chance.choice((f"x-{key}", f"{key}s", "name", "", "a.b", "\u202e"))] = node.pop(key)
        case 4 if isinstance(node, list):
            node *= chance.choice((0, 2, 70))
        case _:
            node[key] = [node[key]] if chance.random() < 0.5 else {"a": node[key]}


def _nodes(value: Any) -> list[Any]:
    """Every table and list in a tree."""
    if not isinstance(value, (dict, list)):
        return []
    inside = value.values() if isinstance(value, dict) else value
    return [value, *(node for item in inside for node in _nodes(item))][:2000]


def _writable(value: Any) -> Any:
    """What TOML has a word for: None and text with zero bytes or half a surrogate have none."""
    if isinstance(value, dict):
        return {str(k): _writable(v) for k, v in value.items() if v is not None}
    if isinstance(value, list):
        return [_writable(v) for v in value[:500] if v is not None]
    return value


WAYS: tuple[Callable[[random.Random, str], bytes], ...] = (
    spoil_bytes, spoil_words, spoil_numbers, spoil_structure,
)  # fmt: skip
