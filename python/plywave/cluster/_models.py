"""Models of many yarns in one call."""

from __future__ import annotations

import contextlib
import tempfile
from typing import Any, Callable, Dict, List, Optional, Sequence

from .._files import PathLike
from .._model import Model
from .._plywave import Error
from .._spec import Spec
from ._cache import Cache
from ._farm import farm
from ._items import yarn_item
from ._workers import check_versions, connect


def build(
    specs: Sequence[Spec],
    client: Any = None,
    *,
    quality: str = "standard",
    seed: int = 1,
    speckle: Any = True,
    cache: Optional[PathLike] = None,
    told: Optional[Callable[[str, int, int], Any]] = None,
) -> List[Model]:
    """Makes the models of yarn specs on the workers of a Dask client: those that `plywave.build` makes, bit for bit.

    Args:
        specs: Paths of yarn specs, their texts, or dicts of their keys.
        client: A `distributed.Client`; by default one process a core of this machine, for the time of the call.
        quality: "preview", "standard" or "reference".
        seed: Seed of all stages.
        speckle: As of `plywave.build`, but for patterns.
        cache: A folder or fsspec URL where shards and models are kept; nothing in it is computed again. By default nothing is kept.
        told: Called with a yarn's name, its finished shards and all of them.

    Returns:
        The models, in the order of the specs.

    Raises:
        Error: for a spec that is refused, workers of another version, a model that could not be made.
    """
    items = [yarn_item(spec, quality, seed=seed, speckle=speckle) for spec in specs]
    models: Dict[str, Model] = {}
    with contextlib.ExitStack() as stack:
        if client is None:
            client = stack.enter_context(connect())
        else:
            check_versions(client)
        if cache is None:
            cache = stack.enter_context(tempfile.TemporaryDirectory(prefix="plywave-"))
        for made in farm(list({item.key: item for item in items}.values()), client, Cache(cache), told=told):
            if made.data is None:
                raise Error(made.error)
            models[made.item.key] = Model.from_bytes(made.data, made.item.name)
    return [models[item.key] for item in items]
