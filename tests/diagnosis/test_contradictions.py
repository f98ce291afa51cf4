"""No sentence of a diagnosis contradicts the numbers beside it: every statement is checked against the JSON."""

import re
from dataclasses import replace

import pytest
from test_probability import HIDDEN, found

from frischid.diagnosis.hypotheses import OTHERS
from frischid.diagnosis.rivals import IN_WORDS
from frischid.diagnosis.verdict import SENTENCES, concluded, with_verdict


def contradictions(told: dict) -> list[str]:
    """Statements of a diagnosis (`Diagnosis.to_dict`) that its own numbers refute."""
    verdict, chance, findings = told["verdict"], told["probabilities"], told["findings"]
    table = [f for f in findings if f["effect"] not in SENTENCES]
    named = [f for f in table if f["significant"]]
    wrong = [
        (verdict == "none" and named, "nothing is missing, but a finding is called missing"),
        (verdict == "effect" and not named, "an effect is missing, but no finding is called missing"),
        ((verdict == "contact") != bool(told["contacts"]), "the contacts and the verdict differ"),
        ((verdict == "unknown") != (told["description"] is not None), "only an unknown residual is described"),
        (abs(sum(chance.values()) - 1) > 1e-6, "the probabilities do not sum to one"),
        (verdict in SENTENCES and findings[0]["effect"] != verdict, "the verdict is not the first line of the table"),
    ]
    for f in table:
        sure = f["gain"] > 0 and not f["withheld"]
        wrong += [
            (f["significant"] and not sure, f"{f['effect']} is called missing, and withheld"),
            (f["probability"] != chance.get(f["effect"], 0.0), f"{f['effect']} has two probabilities"),
            (f["significant"] and f["removed"] <= 0, f"{f['effect']} is called missing, and explains nothing"),
        ]
    if verdict == "several":
        most = max((f["probability"] for f in table), default=0.0)
        wrong.append((chance["several"] <= most, "no finding dominates, but one is more probable"))
    words = {text: name for name, text in IN_WORDS.items()}
    for note in told["notes"]:
        for what, percent in re.findall(r"(?:: |, | or )([a-z][\w ,]*?) \((\d+) %\)", note):
            name = words.get(what, what)
            if name in chance:
                wrong.append(
                    (abs(100 * chance[name] - int(percent)) > 0.51, f"{name}: {percent} % is not {chance[name]}")
                )
        hidden = re.match(r"more than chance, but not called missing: (\w+)", note)
        if hidden:
            wrong.append((any(f["effect"] == hidden[1] for f in named), f"{hidden[1]} is called missing and is not"))
        beside = re.search(r"[Pp]robably also missing, beside (\w+) on [^:]*: (.*); ", note)
        for name in re.findall(r"(\w+) on ", beside[2]) if beside else ():
            (finding,) = (f for f in named if f["effect"] == name)
            wrong.append((finding["own"] <= 0 or not finding["entered"], f"{name} explains nothing of its own"))
            wrong.append((name in (named[0]["effect"], *named[0]["confused_with"]), f"{name} stands beside itself"))
    return [text for condition, text in wrong if condition]


@pytest.mark.parametrize("name", HIDDEN)
def test_no_sentence_contradicts_the_table(name):
    result = found(name)
    assert contradictions(result.to_dict()) == []
    quiet = result.error <= result.criteria.floor_tolerance * result.noise_floor
    there = result.headline
    shown = there.nrmse <= result.criteria.floor_tolerance * there.noise_floor
    assert ("no effect is missing" in result.remainder) == quiet
    assert ("is that of the sensor noise" in result.remainder) == (quiet and shown), "the headline says something else"


@pytest.mark.parametrize("likely", [*OTHERS, "joint_spring"])
@pytest.mark.parametrize("name", ["healthy", "spring", "two"])
def test_whatever_the_probabilities_are_the_verdict_agrees_with_the_table(name, likely):
    result = found(name)
    rules = "effect" if any(f.significant for f in result.findings) else "none"
    chance = dict.fromkeys((*result.probabilities, likely), 0.0) | {likely: 1.0}
    findings = tuple(
        replace(f, probability=chance.get(f.effect, 0.0)) for f in result.findings if f.effect not in SENTENCES
    )
    verdict = concluded(rules, findings, chance, unmodelled=False)
    told = with_verdict(findings, verdict, result.error, chance)
    content = result.to_dict() | {
        "verdict": verdict,
        "probabilities": chance,
        "findings": [f.to_dict() for f in told],
        "notes": [],
        "contacts": [],
        "description": None,
    }
    assert contradictions(content) == []


@pytest.mark.parametrize("name", HIDDEN)
def test_shapes_stay_within_the_range_of_their_grid(name):
    for finding in found(name).findings:
        for effect in finding.members:
            for shape, grid in effect.searched.items():
                assert min(grid) <= effect.parameters[shape] <= max(grid), f"{effect}: {shape}"


def test_a_contradiction_is_seen():
    told = found("spring").to_dict()
    assert contradictions(told | {"verdict": "none"})
    assert contradictions(told | {"probabilities": dict.fromkeys(told["probabilities"], 0.0)})
    first = next(f for f in told["findings"] if f["significant"])
    note = "probably also missing, beside joint_spring on joint2: cogging on joint1; it explains error that no other"
    for own, seen in ((0.0, True), (0.1, False)):
        other = first | {"effect": "cogging", "own": own}
        said = contradictions(told | {"notes": [note], "findings": [first, other]})
        assert ("cogging explains nothing of its own" in said) == seen
