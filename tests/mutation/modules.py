"""Import names of mutated files. Imports no package of the extra `mutation`, so that ordinary tests can use it."""


def module_name(file: str) -> str:
    """Return the import name of a file: the outer folder, as ``gateway/``, is on the path and no package."""
    return file.partition("/")[2].removesuffix(".py").removesuffix("/__init__").replace("/", ".")
