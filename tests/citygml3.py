"""Validates CityGML 3.0 by its official schemas; needs lxml.

    python citygml3.py SCHEMAS FILE      prints what is wrong, a line each

SCHEMAS has citygml/3.0/building.xsd and what it imports, by relative paths.
"""

import sys

from lxml import etree

folder, file = sys.argv[1:]
modules = "".join(
    f'<xs:import namespace="http://www.opengis.net/citygml/{name}/3.0" schemaLocation="{folder}/citygml/3.0/{name}.xsd"/>'
    for name in ("building", "generics")
)
schema = etree.XMLSchema(etree.fromstring(f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">{modules}</xs:schema>'))
schema.validate(etree.parse(file))
for error in schema.error_log:
    print(f"line {error.line}: {error.message}")
