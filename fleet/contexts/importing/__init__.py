"""Import: from tables of located measurements or pictures to autonomy cubes.

Nothing is written here: `fleet.contexts.files.write_cube` does that with what an import gives.
"""

from fleet.contexts.importing.options import Imported, ImportOptions
from fleet.contexts.importing.pictures import import_pictures
from fleet.contexts.importing.points import import_points
from fleet.contexts.importing.source import import_file
from fleet.contexts.importing.table import import_table

__all__ = ["ImportOptions", "Imported", "import_file", "import_pictures", "import_points", "import_table"]
