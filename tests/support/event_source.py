"""A reader of event streams (WHATWG HTML, 9.2.6)."""


class EventSource:
    """Written from the standard, and independent of the gateway.

    ``events``: the id and the data of each event.
    """

    def __init__(self) -> None:
        self.events: list[tuple[str, str]] = []
        self.last_event_id = ""
        self.retry = 0
        self.comments = 0
        self._rest = self._data = self._id = ""

    def feed(self, text: str) -> None:
        *lines, self._rest = (self._rest + text).replace("\r\n", "\n").replace("\r", "\n").split("\n")
        for line in lines:
            name, _, value = line.partition(":")
            value = value.removeprefix(" ")
            if not line:
                self._dispatch()
            elif not name:
                self.comments += 1
            elif name == "data":
                self._data += value + "\n"
            elif name == "id" and "\0" not in value:
                self._id = value
            elif name == "retry" and value.isdecimal():
                self.retry = int(value)

    def _dispatch(self) -> None:
        self.last_event_id = self._id
        if self._data:
            self.events.append((self.last_event_id, self._data.removesuffix("\n")))
        self._data = ""
