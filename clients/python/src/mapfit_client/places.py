"""`Place` and `AsyncPlace`: names under which maps follow one another."""

from .async_maps import AsyncMap
from .maps import Map
from .records import PlaceRecord
from .routes import maps, places
from .wire.awaiting import AsyncConnection
from .wire.blocking import Connection


class NamedPlace:
    """A place's record, as it was last heard of."""

    def __init__(self, record: PlaceRecord) -> None:
        self.record = record

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}: version {self.version}, map {self.map_id}>"

    @property
    def name(self) -> str:
        """The place's name."""
        return self.record["name"]

    @property
    def version(self) -> int:
        """The version that is published."""
        return self.record["version"]

    @property
    def map_id(self) -> str:
        """The id of the map that is published."""
        return self.record["map_id"]


class Place(NamedPlace):
    """A place."""

    def __init__(self, record: PlaceRecord, connection: Connection) -> None:
        super().__init__(record)
        self._connection = connection

    def map(self) -> Map:
        """The map that is published."""
        return Map(self._connection.run(maps.get(self.map_id)), self._connection)

    def publish(self, map_id: str, note: str | None = None) -> "Place":
        """Publishes a map as the next version, and gives the place back."""
        self.record = self._connection.run(places.publish(self.name, map_id, note))
        return self

    def rollback(self, version: int) -> "Place":
        """Publishes an older version's map again, as a new version, and gives the place back."""
        self.record = self._connection.run(places.rollback(self.name, version))
        return self


class AsyncPlace(NamedPlace):
    """A place, awaited."""

    def __init__(self, record: PlaceRecord, connection: AsyncConnection) -> None:
        super().__init__(record)
        self._connection = connection

    async def map(self) -> AsyncMap:
        """The map that is published, downloaded."""
        return await AsyncMap(await self._connection.run(maps.get(self.map_id)), self._connection).download()

    async def publish(self, map_id: str, note: str | None = None) -> "AsyncPlace":
        """Publishes a map as the next version, and gives the place back."""
        self.record = await self._connection.run(places.publish(self.name, map_id, note))
        return self

    async def rollback(self, version: int) -> "AsyncPlace":
        """Publishes an older version's map again, as a new version, and gives the place back."""
        self.record = await self._connection.run(places.rollback(self.name, version))
        return self
