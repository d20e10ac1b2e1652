"""Extensions: one folder for each capability, mounted through one interface (``http.extension``, docs/EXTENDING.md).

The core imports none of them. They are independent of each other, except of pages and of declared dependencies.
"""
