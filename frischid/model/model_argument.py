"""The model that a caller gives: what is no model, such as a whole identification, is refused."""

from __future__ import annotations

from typing import Any

from frischid.core.arguments import check_kind
from frischid.model.model import Model


def check_model(model: Any) -> None:
    """Refuse (InputError) what is no model.

    Examples
    --------
    >>> from frischid.model.model_argument import check_model
    >>> check_model("model.json")
    Traceback (most recent call last):
    frischid.errors.InputError: model must be of the type Model, got 'model.json': frischid.Model.load(path), or ...
    """
    check_kind("model", model, Model, "frischid.Model.load(path), or found.model of found = frischid.identify(...)")
