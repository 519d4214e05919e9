"""The OpenAPI document before a validator: valid 3.1, operations named once, every response described."""

import collections
import json
import sys

from openapi_spec_validator import OpenAPIV31SpecValidator

document = json.load(open(sys.argv[1]))
OpenAPIV31SpecValidator(document).validate()
operations = [
    operation
    for item in document["paths"].values()
    for operation in item.values()
    if isinstance(operation, dict) and "responses" in operation
]
names = collections.Counter(operation["operationId"] for operation in operations)
assert all(count == 1 for count in names.values()), names
bare = [o["operationId"] for o in operations for r in o["responses"].values() if not r.get("description")]
assert not bare, bare
print(len(operations), "operations, all valid")
