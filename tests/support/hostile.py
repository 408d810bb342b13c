"""Names that would do harm where they were printed as they are."""

from __future__ import annotations

import random

WORDS = (  # of C, its headers and its compilers; legal names here
    *("int", "double", "main", "NULL", "INFINITY", "NAN", "errno", "M_PI", "linux", "unix", "I", "complex", "restrict"),
    *("inline", "asm", "typeof", "assert", "signbit", "isnan", "sin", "cos", "stdin", "EOF", "environ", "register"),
    *("__FILE__", "__attribute__", "_Complex", "__linux__", "h", "q", "v", "a", "u", "out", "t0", "t1", "turn"),
    *("PADDED",),
    *("lambda", "None", "import", "self", "E", "pi", "S", "N", "oo", "zoo", "Symbol", "exec", "__import__"),
    *("name", "loop"),
)
PIECES = (
    *('"', "'", "\\", "\n", "\r", "\t", "\v", "\f", "\0", "\x07", "\x1b[31m", "\x7f", "\x85", "\u2028"),
    *("\u202e", "\ufeff"),
    *("*/", "/*", "//", "??/", "??/\n", "<%", "%:", "#include </etc/passwd>\n", "#define double int\n", "\\\n"),
    *("\\u002a/",),
    *("%s", "%n", "%1$*2$x", "{}", "{0.__class__}", "{{ 7*7 }}", "{% raw %}", "{# #}", "$(reboot)", "`reboot`"),
    *("; rm -rf /",),
    *("__attribute__((constructor)) void f(void){}", "system(0);", 'asm("hlt")', "#pragma GCC poison x\n"),
    *('_Pragma("x")',),
    *("/", "..", "../../", "/etc/passwd", "C:\\", "~", "|", "&", ">", "<", "!", "*", "?", "-o", "--version"),
    *("@file", " "),
    *("__import__('os').system('true')", "eval(1)", "lambda: 0", "1e400", "nan", "].pop(", "</robot>", "]]>"),
    *("&lt;", "'''"),
    *("\N{GREEK SMALL LETTER PHI}", "\N{FULLWIDTH LATIN SMALL LETTER A}", "\N{COMBINING DIAERESIS}"),
    *("\U0001f600", "\u0130"),
    *WORDS,
)
XML = frozenset("\0\x07\x1b\x0b\x0c\x7f\ud800")  # characters that XML does not have


def hostile_name(seed: int) -> str:
    """The name of that seed: one to five pieces."""
    chance = random.Random(f"hostile {seed}")
    return "".join(chance.choice(PIECES) for _ in range(chance.choice((1, 1, 2, 3, 5)))) * chance.choice(
        (1,) * 30 + (40,)
    )
