"""An exported run."""

from rig.record.export import FORMATS, export, tables
from rig.record.export.files import description


def written(run, to, folder, **wanted):
    """The file that is the only one in `folder` after an export."""
    path = folder / f"export{FORMATS[to].suffix}"
    export(tables(run, **wanted), to, path, description(run))
    assert [one.name for one in folder.iterdir()] == [path.name]
    return path
