"""Write ``urban_street/vehicles/index.json`` (`urban_street.vehicles.index`); ``make vehicles`` runs it."""

from __future__ import annotations

import json

from urban_street.vehicles import KINDS, build_vehicle
from urban_street.vehicles.index import FILE, index_entry

if __name__ == "__main__":
    entries = {kind: index_entry(build_vehicle(kind))._asdict() for kind in KINDS}
    lines = ",\n".join(f"{json.dumps(kind)}: {json.dumps(entry)}" for kind, entry in entries.items())
    FILE.write_text(f"{{\n{lines}\n}}\n")
