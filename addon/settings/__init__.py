"""The settings of a bake. Flags and properties are made from one definition each."""
