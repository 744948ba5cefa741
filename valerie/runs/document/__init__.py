"""The spec as users write it: fields, notations, schema."""
