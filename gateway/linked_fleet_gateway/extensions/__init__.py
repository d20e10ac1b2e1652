"""Extensions: one folder for each capability, mounted through one interface (``http.extension``, docs/EXTENDING.md).

The core imports none of them. Extensions import only pages and the extensions that they declare to need.
"""
