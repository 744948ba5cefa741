"""The spec as people write it: fields, notations, schema."""
