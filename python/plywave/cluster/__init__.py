"""Many yarns on many machines: shards on Dask workers, the same bits as one machine makes, and a cache in which nothing is computed twice (docs/howto/cluster.md).

    import plywave.cluster

    models = plywave.cluster.build(["fabrics/polyester.toml", "fabrics/cotton.toml"], quality="preview", cache="cache")

Needs `pip install plywave[cluster]`: Dask with its scheduler. Workers need plywave of the same version, and no common file system: shards travel as bytes.
"""

from ._cache import Cache
from ._farm import Made, farm
from ._items import Item, compare_item, family_item, fiber_item, speckle_item, twin_item, yarn_item
from ._library import Library
from ._models import build
from ._report import report
from ._workers import connect

__all__ = ["Cache", "Item", "Library", "Made", "build", "compare_item", "connect", "family_item", "farm", "fiber_item", "report", "speckle_item", "twin_item", "yarn_item"]
