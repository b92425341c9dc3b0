"""Compares an archive of arrays with the CSV of the same table, cell by cell; prints the number of rows."""

import csv
import sys
import zipfile

import numpy

archive_path, table_path = sys.argv[1:]
assert zipfile.ZipFile(archive_path).testzip() is None
archive = numpy.load(archive_path, allow_pickle=False)
with open(table_path, newline="", encoding="utf-8") as file:
    header, *rows = csv.reader(file)
assert archive.files == header, archive.files
for place, name in enumerate(header):
    column, cells = archive[name], [row[place] for row in rows]
    assert column.shape == (len(rows),), (name, column.shape)
    assert column.flags.c_contiguous and column.dtype.byteorder in "=<", (name, column.dtype)
    for cell, value in zip(cells, column):
        if column.dtype.kind == "U":
            assert str(value) == cell, (name, cell, value)
        elif column.dtype.kind in "iu":
            assert int(value) == int(cell), (name, cell, value)
        elif cell == "":
            assert numpy.isnan(value), (name, cell, value)
        else:
            assert column.dtype.type(cell) == value, (name, cell, value)
print(len(rows))
