"""A courier between a store and receivers: when it gives up, asks for consent, and how it numbers deliveries."""

import asyncio
import base64
import hmac
import itertools
import ssl
import time
import uuid
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass, replace
from ipaddress import IPv4Network
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Record, Subscription
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_gateway.subscriptions import courier as courier_module
from linked_fleet_gateway.subscriptions import redis_scripts as scripts
from linked_fleet_gateway.subscriptions.courier import Courier
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.store import OutgoingMessage, SubscriptionStore
from linked_fleet_webhooks.delivery_pace import SUSPEND_AFTER
from linked_fleet_webhooks.network import Address, Network
from linked_fleet_webhooks.receiver import Receiver
from receivers import Answer, Seen, consents, receiving, retry_after
from receivers import Receiver as CallbackReceiver
from redis_servers import single
from running import PATIENCE_S

pytestmark = pytest.mark.virtual
PATH = "/toy/elbow/rotation"
PLAIN = ssl.create_default_context()
LOOPBACK = (IPv4Network("127.0.0.0/8"),)


class Outside(Network):
    """Loopback treated as public: it may be reached, and its receivers must consent."""

    def __init__(self) -> None:
        super().__init__(lookup=lambda *_: ["127.0.0.1"], ports=(range(1, 65536),))

    def _judge(self, text: str) -> Address | None:
        return Address(text, allowed=False)


class Toy:
    """A tree with one resource, whose only fact the test changes."""

    def __init__(self) -> None:
        self.fact = 0
        self.fan_out = FanOut(lambda base, sees: self)

    def resolve(self, path: str) -> Resource | None:
        facts = Source(facts=lambda: self.fact)
        return Resource(PATH, "a toy", lambda graph: None, source=facts) if path == PATH else None

    def subtree(self, path: str) -> list[tuple[str, bool]]:
        return [(PATH, True)]

    def become(self, fact: int) -> None:
        self.fact = fact
        self.fan_out.mark_changed(PATH)

    @property
    def version(self) -> str:
        return Source(facts=lambda: self.fact).read().version


@dataclass
class Work:
    """A running courier and its surroundings."""

    toy: Toy
    courier: Courier
    store: SubscriptionStore
    receiver: CallbackReceiver
    id: str

    async def requests(self, count: int, method: str | None = None) -> list[Seen]:
        """Return the log once it has so many requests."""
        while len(log := self.receiver.log(method=method)) < count:  # noqa: ASYNC110 - in another thread
            await asyncio.sleep(0.01)
        return log

    async def until(self, probe: Callable[[Record], bool], what: str) -> Record:
        """Return the record once it satisfies the probe."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            record = await self.store.get_record(self.id)
            assert record is not None
            if probe(record):
                return record
            assert time.monotonic() < deadline, f"never happened: {what}, but {record.delivery}"
            await asyncio.sleep(0.01)

    async def in_state(self, state: DeliveryState) -> Delivery:
        record = await self.until(lambda record: record.delivery.state is state, state)
        return record.delivery


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with single(tmp_path_factory.mktemp("redis")) as servers:
        yield servers.url


@pytest.fixture
def there() -> Iterator[CallbackReceiver]:
    with receiving() as receiver:
        yield receiver


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Retry at once; the list contains the number of failures before each retry."""
    asked: list[int] = []

    def delay_s(failures: int, draw: float) -> float:
        asked.append(failures)
        return 0.0

    monkeypatch.setattr(courier_module, "backoff_s", delay_s)
    return asked


@asynccontextmanager
async def work(
    url: str,
    receiver: CallbackReceiver,
    delivery: Delivery | None = None,
    network: Network | None = None,
    *,
    namespace: str = "",
    loses: bool = False,
) -> AsyncIterator[Work]:
    """Run a courier that has just taken over a subscription; unless it ``loses`` that, it must run to the end."""
    subscription = Subscription(
        id=str(uuid.uuid4()),
        owner="/toy/elbow",
        resource=PATH,
        kind=Kind.CALLBACK,
        media_type="text/turtle",
        base="http://fleet.example:8000",
        client="192.0.2.7",
        created_ns=time.time_ns(),
        callback=receiver.url(host="receiver.example"),
    )
    toy, delivery = Toy(), delivery or Delivery()
    network = network or Network(LOOPBACK, lookup=lambda *_: ["127.0.0.1"])
    async with SubscriptionStore(url, namespace or uuid.uuid4().hex, "a") as store:
        await store.add(subscription, delivery, 10)
        with closing(network):
            sender = Receiver(network, subscription.callback, ssl_context=PLAIN)
            courier = Courier(Record(subscription, delivery, "a"), store, toy.fan_out, sender, consent_required=True)
            courier.start()
            try:
                yield Work(toy, courier, store, receiver, subscription.id)
                assert courier.running is not loses
            finally:
                await courier.stop()


def another(at: Work, record: Record) -> Courier:
    """Return a courier for the same store, fleet and receiver."""
    sender = Receiver(Network(LOOPBACK, lookup=lambda *_: ["127.0.0.1"]), at.receiver.url(), ssl_context=PLAIN)
    return Courier(record, at.store, at.toy.fan_out, sender, consent_required=True)


def numbers(log: list[Seen]) -> list[int]:
    return [int(seen.headers["linked-fleet-delivery"]) for seen in log]


# When it gives up


async def test_repeated_failures_suspend_a_callback_until_it_is_resumed(
    url: str, there: CallbackReceiver, at_once: list[int]
) -> None:
    there.default = Answer(500)
    async with work(url, there) as at:
        delivery = await at.in_state(DeliveryState.SUSPENDED)
        assert (delivery.failures, delivery.last_status) == (SUSPEND_AFTER, 500)
        assert "500" in delivery.reason
        assert at_once == list(range(1, SUSPEND_AFTER))
        log = there.log()
        assert len(log) == SUSPEND_AFTER
        assert len({(seen.headers["webhook-id"], seen.body) for seen in log}) == 1
        at.toy.become(1)
        at.toy.become(2)
        at.courier.resume()
        await at.requests(2 * SUSPEND_AFTER)
        await at.in_state(DeliveryState.SUSPENDED)
        assert at_once == 2 * list(range(1, SUSPEND_AFTER))
        there.default = Answer()
        at.courier.resume()
        log = (await at.requests(2 * SUSPEND_AFTER + 2))[2 * SUSPEND_AFTER :]
        assert numbers(log) == [1, 2]
        assert log[1].headers["linked-fleet-version"] == at.toy.version
        delivery = (await at.until(lambda record: not record.delivery.failures, "success")).delivery
        assert (delivery.state, delivery.last_status, delivery.reason) == (DeliveryState.ACTIVE, 204, "")


async def test_failures_count_on_with_another_gateway(url: str, there: CallbackReceiver) -> None:
    there.default = Answer(500)
    async with work(url, there, Delivery(DeliveryState.FAILING, failures=SUSPEND_AFTER - 2)) as at:
        record = await at.until(lambda record: record.delivery.failures == SUSPEND_AFTER - 1, "one more")
        assert record.delivery.state is DeliveryState.FAILING
    async with work(url, there, Delivery(DeliveryState.FAILING, failures=SUSPEND_AFTER - 1)) as at:
        assert (await at.in_state(DeliveryState.SUSPENDED)).failures == SUSPEND_AFTER


async def test_a_suspended_callback_is_not_tried_after_takeover(url: str, there: CallbackReceiver) -> None:
    async with work(url, there, Delivery(DeliveryState.SUSPENDED, failures=SUSPEND_AFTER)) as at:
        at.toy.become(1)
        # resumed only in the store: for a courier that begins later, as after a takeover
        late = another(at, Record(at.courier.subscription, at.courier.delivery, "a"))
        assert there.log() == []
        await at.store.resume(at.id)
        late.start()
        await at.requests(1)
        await late.stop()


async def test_retry_after_counts_when_it_is_longer_than_the_backoff(
    url: str, there: CallbackReceiver, at_once: list[int]
) -> None:
    there.script(retry_after(0), retry_after(3600))
    async with work(url, there) as at:
        record = await at.until(lambda record: record.delivery.failures == 2, "the second failure")
        assert record.delivery.last_status == 503
        assert len(there.log()) == 2
        at.courier.resume()  # nothing else makes it continue
        assert numbers(await at.requests(3)) == [1, 1, 1]


# Consent


async def test_nothing_is_delivered_before_the_receiver_consents(
    url: str, there: CallbackReceiver, at_once: list[int]
) -> None:
    """A failing receiver is asked again; a refusing one only after somebody resumes."""
    there.script(Answer(500), Answer(429), consents("elsewhere.example"))
    refusing = Delivery(DeliveryState.AWAITING_CONSENT)
    async with work(url, there, refusing, Outside()) as at:
        delivery = await at.in_state(DeliveryState.SUSPENDED)
        assert delivery.failures == 3
        assert "WebHook-Allowed-Origin" in delivery.reason
        assert not delivery.consented
        at.toy.become(1)
        at.toy.become(2)
        assert [seen.method for seen in there.log()] == 3 * ["OPTIONS"]
        assert all(seen.headers["webhook-request-origin"] == "fleet.example" for seen in there.log())
        there.consent = consents("fleet.example")
        at.courier.resume()
        (first,) = await at.requests(1, "POST")
        # not the value at the time of the request for consent
        assert first.headers["linked-fleet-version"] == at.toy.version
        assert first.headers["webhook-request-origin"] == "fleet.example"
        at.toy.become(3)
        assert numbers(await at.requests(2, "POST")) == [1, 2]
        assert [seen.method for seen in there.log()] == 4 * ["OPTIONS"] + 2 * ["POST"]
        record = await at.until(lambda record: record.delivery.last_status == 204, "success")
        assert (record.delivery.state, record.delivery.consented) == (DeliveryState.ACTIVE, True)


@pytest.mark.parametrize("answer", [Answer(405), Answer(200), Answer(404), Answer(302, {"Location": "/"})])
async def test_a_refusal_is_an_answer(url: str, there: CallbackReceiver, answer: Answer) -> None:
    """A receiver that refuses gets only one request for consent."""
    there.consent = answer
    async with work(url, there, Delivery(DeliveryState.AWAITING_CONSENT), Outside()) as at:
        delivery = await at.in_state(DeliveryState.SUSPENDED)
        assert (delivery.failures, delivery.last_status) == (1, answer.status)
        assert [seen.method for seen in there.log()] == ["OPTIONS"]


async def test_while_consent_is_awaited_the_subscription_says_so(url: str, there: CallbackReceiver) -> None:
    there.script(Answer(stalls=True))
    waiting = Delivery(DeliveryState.AWAITING_CONSENT)
    async with work(url, there, waiting, Outside()) as at:
        await at.requests(1, "OPTIONS")
        await at.in_state(DeliveryState.AWAITING_CONSENT)
        there.release()
        delivery = (await at.until(lambda record: bool(record.delivery.failures), "a refusal")).delivery
        assert delivery.state is DeliveryState.SUSPENDED
        assert "WebHook-Allowed-Origin" in delivery.reason
        assert there.log(method="POST") == []


async def test_the_rate_that_is_allowed_becomes_an_interval(url: str, there: CallbackReceiver) -> None:
    there.consent = consents("*", "120")
    async with work(url, there, network=Outside()) as at:
        await at.requests(1, "POST")
        record = await at.until(lambda record: record.delivery.last_status == 204, "the first delivery")
        assert record.delivery.allowed_interval_s == 0.5
        assert record.delivery.consented
        for fact in range(1, 50):
            at.toy.become(fact)
            await at.store.get_record(at.id)  # enough time for a courier that must not wait
        log = await at.requests(3, "POST")
        assert numbers(log) == [1, 2, 3]  # the second waits meanwhile, the third is the state after that
        assert log[-1].headers["linked-fleet-version"] == at.toy.version


async def test_the_rate_that_is_allowed_is_kept_when_a_delivery_is_repeated(
    url: str, there: CallbackReceiver, at_once: list[int]
) -> None:
    """One per minute, whatever the back-off: a failed delivery is not repeated earlier, and nothing overtakes it."""
    there.consent = consents("*", "1")
    there.script(there.consent, Answer(500), retry_after(0))
    async with work(url, there, network=Outside()) as at:
        for failures, status in ((1, 500), (2, 503)):
            record = await at.until(lambda record, n=status: record.delivery.last_status == n, f"a {status}")
            assert record.delivery.allowed_interval_s == 60.0
            for fact in range(1, 50):
                at.toy.become(fact)
                await at.store.get_record(at.id)  # enough time for a courier that must not wait
            assert numbers(there.log(method="POST")) == failures * [1]
            at.courier.resume()  # nothing else makes it continue
        assert numbers(await at.requests(3, "POST")) == [1, 1, 1]


async def test_a_courier_that_lost_its_subscription_in_a_pause_stops(url: str, there: CallbackReceiver) -> None:
    """The pause can be longer than a lease: another gateway has made progress by then."""
    there.consent = consents("*", "20")
    outside, namespace = Outside(), uuid.uuid4().hex
    async with (
        work(url, there, network=outside, namespace=namespace, loses=True) as at,
        SubscriptionStore(url, namespace, "b") as other,
    ):
        await at.requests(1, "POST")
        await at.until(lambda record: record.delivery.last_status == 204, "the first delivery")
        at.toy.become(1)
        while not (await at.store.read_backlog(at.id)).entries:  # noqa: ASYNC110 - another process knows it
            await asyncio.sleep(0.01)
        (record,) = [record async for record in other.take_over("a")]
        sender = Receiver(outside, there.url(), ssl_context=PLAIN)
        hasty = replace(record, delivery=replace(record.delivery, allowed_interval_s=0.0))
        taker = Courier(hasty, other, at.toy.fan_out, sender, consent_required=True)
        taker.start()
        await at.requests(2, "POST")
        at.toy.become(2)
        await at.requests(3, "POST")
        assert at.courier._task is not None
        await at.courier._task  # by itself, after its pause
        assert numbers(there.log(method="POST")) == [1, 2, 3]
        await taker.stop()


async def test_a_courier_that_lost_its_subscription_does_not_repeat(url: str, there: CallbackReceiver) -> None:
    """A gateway that was suspended for longer than its lease sends no older number after a higher one."""
    there.script(Answer(), retry_after(5))
    namespace = uuid.uuid4().hex
    async with work(url, there, namespace=namespace, loses=True) as at, SubscriptionStore(url, namespace, "b") as other:
        await at.requests(1)
        at.toy.become(1)
        await at.until(lambda record: record.delivery.failures == 1, "the failure")
        (record,) = [record async for record in other.take_over("a")]
        taker = another(replace(at, store=other), record)
        taker.start()
        await at.requests(3)
        at.toy.become(2)
        await at.requests(4)
        assert at.courier._task is not None
        await at.courier._task  # by itself, after its pause
        assert numbers(there.log()) == [1, 2, 2, 3]
        await taker.stop()


async def test_an_address_that_changes_between_look_and_delivery_is_asked_again(
    url: str, there: CallbackReceiver
) -> None:
    """A trusted receiver moved to an address that needs consent: nothing is sent there, and it does not loop."""
    looks = itertools.count(1)
    anywhere = (range(1, 65536),)
    moving = Network(LOOPBACK, lookup=lambda *_: ["8.8.8.8"] if next(looks) == 3 else ["127.0.0.1"], ports=anywhere)
    async with work(url, there, network=moving) as at:
        delivery = await at.in_state(DeliveryState.AWAITING_CONSENT)
        assert delivery.failures == 1
        assert numbers(await at.requests(1)) == [1]
        await at.in_state(DeliveryState.ACTIVE)


# Its numbers


async def test_entries_queued_by_a_late_command_are_delivered_in_order(url: str, there: CallbackReceiver) -> None:
    """A command thought lost in an outage was executed: its number must not be skipped."""
    async with work(url, there) as at:
        await at.requests(1)
        await at.until(lambda record: record.delivery.last_status == 204, "delivered")
        await at.store.advance_queue(
            at.id, None, OutgoingMessage(PATH, "late", "text/turtle", b"late"), at.courier.delivery
        )
        at.toy.become(1)
        log = await at.requests(3)
        assert numbers(log) == [1, 2, 3]
        assert log[1].body == b"late"
        assert log[2].headers["linked-fleet-version"] == at.toy.version
        await at.until(lambda record: record.delivery.last_status == 204, "delivered")


async def test_a_command_that_comes_very_late_brings_nothing_back(url: str, there: CallbackReceiver) -> None:
    """It was sent before a connection was lost, and is executed after later commands."""
    async with work(url, there) as at:
        await at.requests(1)
        await at.until(lambda record: record.delivery.last_status == 204, "delivered")
        redis, lost = at.store._redis, list[tuple[Any, ...]]()
        run_script = redis.run_script

        async def lose(script: str, *arguments: Any) -> Any:
            if script == scripts.ADVANCE and not lost:
                lost.append((script, *arguments))
                raise RedisUnavailable("the connection was lost")
            return await run_script(script, *arguments)

        redis.run_script = lose  # type: ignore[method-assign]
        at.toy.become(1)
        await at.requests(2)
        at.toy.become(2)
        await at.requests(3)
        await run_script(*lost[0])
        at.toy.become(3)
        log = await at.requests(4)
        assert numbers(log) == [1, 2, 3, 4]
        assert log[3].headers["linked-fleet-version"] == at.toy.version


async def test_another_courier_goes_on_where_one_stopped(url: str, there: CallbackReceiver) -> None:
    there.script(Answer(), Answer(stalls=True))
    async with work(url, there) as at:
        await at.requests(1)
        at.toy.become(1)
        await at.requests(2)
        at.toy.become(2)
        record = await at.store.get_record(at.id)
        assert record is not None
        next_one = another(at, record)
        next_one.start()
        log = await at.requests(4)
        assert numbers(log) == [1, 2, 2, 3]
        assert log[1].body == log[2].body
        assert log[3].headers["linked-fleet-version"] == at.toy.version
        await next_one.stop()


async def test_a_courier_that_has_lost_its_subscription_ends(url: str, there: CallbackReceiver) -> None:
    async with work(url, there) as at:
        await at.requests(1)
        await at.until(lambda record: record.delivery.last_status == 204, "delivered")
        subscription = replace(at.courier.subscription, id=str(uuid.uuid4()))
        stray = another(at, Record(subscription, Delivery(), "a"))
        stray.start()
        assert stray._task is not None
        await stray._task  # by itself
        await stray.stop()
        assert len(there.log()) == 1


async def test_stopping_a_courier_can_be_cancelled(url: str, there: CallbackReceiver) -> None:
    """Otherwise a gateway that ends while a subscription is deleted would never end."""
    async with work(url, there) as at:
        record = Record(at.courier.subscription, Delivery(DeliveryState.SUSPENDED), "a")
        courier = another(at, record)
        courier.start()
        stopping = asyncio.create_task(courier.stop())
        await asyncio.sleep(0)
        stopping.cancel()
        await asyncio.wait([stopping])
        assert stopping.cancelled()
        await courier.stop()


# Other options


SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


def verify(seen: Seen, secret: str) -> None:
    """Verify the signature as Standard Webhooks requires of a receiver."""
    signed = f"{seen.headers['webhook-id']}.{seen.headers['webhook-timestamp']}.".encode() + seen.body
    digest = hmac.new(base64.b64decode(secret.removeprefix("whsec_")), signed, "sha256").digest()
    assert seen.headers["webhook-signature"] == f"v1,{base64.b64encode(digest).decode()}"


async def change(at: Work, **options: Any) -> None:
    """Change options like a PATCH through another gateway, and deliver the news of it."""
    before = at.courier.subscription
    assert await at.store.change_options(before, replace(before.options, **options))
    record = await at.store.get_record(at.id)
    assert record is not None
    at.courier.change_options(record.subscription)


async def test_another_media_type_begins_with_the_present_state_after_what_is_queued(
    url: str, there: CallbackReceiver
) -> None:
    """A delivery in progress is not cancelled or repeated; the queue stays unchanged; numbers have no gaps."""
    there.script(Answer(), Answer(stalls=True))
    async with work(url, there) as at:
        await at.requests(1)
        at.toy.become(1)
        await at.requests(2)
        await change(at, media_type="application/n-triples")
        at.toy.become(2)
        there.release()
        log = await at.requests(3)
        assert numbers(log) == [1, 2, 3]
        types = [seen.headers["content-type"] for seen in log]
        assert types == ["text/turtle; charset=utf-8"] * 2 + ["application/n-triples"]
        assert log[2].headers["linked-fleet-version"] == at.toy.version
        await change(at, media_type="application/ld+json")
        log = await at.requests(4)
        assert (numbers(log)[-1], log[3].headers["content-type"]) == (4, "application/ld+json")
        await at.until(lambda record: record.delivery.last_status == 204, "delivered")


async def test_a_change_while_consent_is_awaited_holds_for_the_first_delivery(
    url: str, there: CallbackReceiver
) -> None:
    there.consent = Answer(503)
    async with work(url, there, network=Outside()) as at:
        await at.in_state(DeliveryState.AWAITING_CONSENT)
        await change(at, media_type="application/n-triples", secret=SECRET)
        there.consent = consents()
        at.courier.resume()
        (seen,) = await at.requests(1, "POST")
        assert seen.headers["content-type"] == "application/n-triples"
        verify(seen, SECRET)


async def test_another_secret_signs_from_the_next_attempt_on(
    url: str, there: CallbackReceiver, at_once: list[int]
) -> None:
    """Queued messages get new signatures too, with the same body and id. A change of the interval repeats nothing."""
    there.script(Answer(), Answer(500, stalls=True))
    async with work(url, there) as at:
        await at.requests(1)
        at.toy.become(1)
        await at.requests(2)
        await change(at, secret=SECRET, interval_s=0.001)
        there.release()
        log = await at.requests(3)
        assert numbers(log) == [1, 2, 2]
        assert "webhook-signature" not in log[1].headers
        assert (log[1].body, log[1].headers["webhook-id"]) == (log[2].body, log[2].headers["webhook-id"])
        verify(log[2], SECRET)
        at.toy.become(2)
        assert numbers(await at.requests(4)) == [1, 2, 2, 3]
