"""The extension ``query``: SPARQL 1.1 over the live fleet, evaluated in a process of its own."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.extensions.query.description import Endpoint, PostQuery, branch
from linked_fleet_gateway.extensions.query.http import post_query, read_query
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.html import NavigationEntry


class QueryExtension(Extension):
    name = "query"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    at_root = ("query",)
    views = ("linked_fleet_gateway.extensions.query.page:VIEW",)
    operations = ("linked_fleet_gateway.extensions.query.operations:operations",)
    navigation = (NavigationEntry("Query", "/query", 30),)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with Queries(core.live, navigation=core.navigation) as queries:
            yield Mount(
                branches=(branch(queries),),
                readers={Endpoint: read_query},
                writers={PostQuery: post_query},
                services=(queries,),
            )
