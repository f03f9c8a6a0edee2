"""Every test of the package can fail: it asserts or expects an error, itself or through a function that it calls."""

import ast
from pathlib import Path

# Names that can end a test.
ENDS = {"raises", "warns", "fail", "check_returncode", "check_call", "check_output", "assert_allclose", "assert_array_equal"}


def functions(text: str) -> dict[str, set[str]]:
    """The names in the bodies of all functions, with "assert" where one asserts."""
    found: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.FunctionDef):
            continue
        names = found.setdefault(node.name, set())
        for part in ast.walk(node):
            if isinstance(part, (ast.Assert, ast.Raise)):
                names.add("assert")
            elif isinstance(part, ast.Name):
                names.add(part.id)
            elif isinstance(part, ast.Attribute):
                names.add(part.attr)
            elif isinstance(part, ast.keyword) and part.arg == "check" and getattr(part.value, "value", None) is True:
                names.add("assert")
    return found


def idle(texts: list[str]) -> list[str]:
    """Tests that nothing can make fail but an error of the code that they call."""
    bodies: dict[str, set[str]] = {}
    for text in texts:
        for name, names in functions(text).items():
            bodies.setdefault(name, set()).update(names)
    ends = ENDS | {"assert"}
    while more := {name for name, names in bodies.items() if name not in ends and names & ends}:
        ends |= more
    return sorted(name for name in bodies if name.startswith("test_") and name not in ends)


def test_every_test_asserts():
    files = sorted(Path(__file__).parent.glob("*.py"))
    texts = [file.read_text() for file in files]
    assert sum(text.count("\ndef test_") for text in texts) > 100
    assert idle(texts) == []


def test_idle_tests_are_found():
    text = "def helper(x):\n    assert x\ndef test_a():\n    helper(1)\ndef test_b():\n    print(1)\n"
    assert idle([text]) == ["test_b"]
