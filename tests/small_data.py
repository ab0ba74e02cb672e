"""Small stand-ins for ../shared/data, in the same formats: worlds of BARN, and grids with known optima."""

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core import twins

DATA = Path(__file__).parent / "data"
MODEL = """<model name='unit_cylinder_{i}'><static>1</static><pose>{x:.3f} {y:.3f} 0.5 0 0 0</pose>
<link name='link'><collision name='collision'>
<geometry><cylinder><radius>0.075</radius><length>1</length></cylinder></geometry></collision></link></model>"""
WORLD = """<sdf version='1.6'><world name='default'><model name='ground_plane'><static>1</static>
<link name='link'><collision name='collision'><geometry><plane><normal>0 0 1</normal><size>100 100</size></plane>
</geometry></collision></link></model>
{models}</world></sdf>"""
CELL_M, CORRIDOR_ROWS, COLUMNS = 0.15, 34, 30


def write_barn(folder: Path) -> None:
    """The worlds of data/barn as the benchmark has them: worlds/world_N.world and paths/path_N.npy."""
    for name in ("worlds", "paths"):
        (folder / name).mkdir(parents=True)
    for block in (DATA / "barn" / "worlds.txt").read_text().split("\n\n"):
        title, *picture, path = block.strip().splitlines()
        number = title.split()[1]
        field = np.array([[cell == "#" for cell in row] for row in reversed(picture)])
        (folder / "worlds" / f"world_{number}.world").write_text(_world(field))
        cells = np.array([cell.split(",") for cell in path.split()[1:]], dtype=np.int64)
        np.save(folder / "paths" / f"path_{number}.npy", cells)


def _world(field: NDArray[np.bool_]) -> str:
    """The field behind a corridor with a closed end, x from -4.5 m and y from 0 on."""
    corridor = np.zeros((CORRIDOR_ROWS, COLUMNS), dtype=bool)
    corridor[:, [0, -1]] = corridor[0] = True
    cells = np.argwhere(np.concatenate([corridor, field]))
    places = (cells[:, ::-1] + 0.5) * CELL_M - (COLUMNS * CELL_M, 0.0)
    return WORLD.format(models="\n".join(MODEL.format(i=i, x=x, y=y) for i, (x, y) in enumerate(places)))


def write_cities(folder: Path) -> None:
    """Grids of blocks and streets in Moving AI's format, with lengths that Dijkstra finds, slowly."""
    for seed, city in enumerate(("Berlin_0_256", "Boston_1_256")):
        blocked = _city(np.random.default_rng(seed))
        rows = ["".join("@" if cell else "." for cell in row) for row in blocked]
        head = ["type octile", f"height {len(blocked)}", f"width {len(blocked[0])}", "map"]
        (folder / f"{city}.map").write_text("\n".join([*head, *rows]) + "\n")
        free = [(int(row), int(column)) for row, column in np.argwhere(blocked == 0)]
        lines = ["version 1"]
        for start in free[:: len(free) // 5][:5]:
            lengths = sorted(twins.dijkstra(blocked, start).items(), key=lambda item: item[1])
            for (row, column), length in itertools.islice(lengths, 1, None, max(1, len(lengths) // 200)):
                ends = (start[1], start[0], column, row)
                lines.append("\t".join(map(str, (0, city, *blocked.shape[::-1], *ends, repr(length)))))
        (folder / f"{city}.map.scen").write_text("\n".join(lines) + "\n")


def _city(rng: np.random.Generator, size: int = 72) -> NDArray[np.uint8]:
    """Houses of many sizes, some grown together, in a square."""
    blocked = np.zeros((size, size), dtype=np.uint8)
    for _ in range(90):
        row, column = rng.integers(size, size=2)
        height, width = rng.integers(2, 12, size=2)
        blocked[row : row + height, column : column + width] = 1
    return blocked
