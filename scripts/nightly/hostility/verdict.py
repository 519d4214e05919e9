"""What is a failure, and what is not.

500 always is. 503 is one, too, unless the service says that it has too much to do right now, and when to come again: a
refusal for load, which may happen to anybody. Those are counted apart, by route and by what they said. Every refusal
that is not HTTP's own must come with a problem. A number that is not finite anywhere in JSON is a failure, and so is
silence.
"""

import re
import sys
from collections import Counter
from dataclasses import dataclass, field

from service.connection import Answer

from .attack import Attack
from .wire import Outcome

# What the HTTP library says itself, of what it cannot read; there is no request yet that a problem could speak of.
PROTOCOLS_OWN = (400, 414, 431, 505)

# What a 503 says that is a refusal for load: src/http/shared/ration.rs, body.rs and compute.rs. A database or a store
# of artifacts that is away is none: in these suites nobody takes them away.
LOAD = (
    "as many bytes of answers are on their way as may be",
    "the service holds as many bytes of requests as it may",
    "the service is busy",
)
# What differs between two requests of one route, beside what follows the question mark.
IDS = re.compile(r"[0-9a-f]{8}-[0-9a-f-]{27}")


@dataclass
class Verdicts:
    """Failures, each with the request that led to it, and counts of all that happened."""

    failures: list[str] = field(default_factory=list)
    statuses: Counter = field(default_factory=Counter)
    #: 503s, by route and by what they said.
    later: Counter = field(default_factory=Counter)
    #: Refusals in the protocol's own words: a status and no problem.
    bare: list[str] = field(default_factory=list)
    #: What else a suite has to tell.
    figures: dict = field(default_factory=dict)

    def fail(self, what: str) -> None:
        """Notes a failure, and says it at once: a nightly run is long."""
        self.failures.append(what)
        print(f"\n{what}", file=sys.stderr, flush=True)

    def judge_answer(self, name: str, answer: Answer, route: str = "", is_head: bool = False) -> None:
        """What holds for every answer, whatever was asked. `route` is the method and the path, where they say more than
        the name does."""
        self.statuses[answer.status] += 1
        if answer.status == 503:
            self._judge_later(name, answer, IDS.sub("{id}", (route or name).partition("?")[0]))
        elif answer.status >= 500:
            self.fail(f"{name}: {answer.status} {answer.body[:300]!r}")
        elif answer.status >= 400 and not is_head and not answer.is_problem():
            self.bare.append(f"{name}: {answer.status}")
            if answer.status not in PROTOCOLS_OWN:
                self.fail(f"{name}: {answer.status} without a problem")
        media = answer.headers.get("content-type", "").split(";")[0]
        if media.endswith("json") and not is_head and "content-encoding" not in answer.headers:
            try:
                answer.json()
            except (ValueError, RecursionError) as error:
                self.fail(f"{name}: {answer.status}, and its JSON is none: {error}")

    def _judge_later(self, name: str, answer: Answer, route: str) -> None:
        """A 503: noted, and a failure where it is not the service's word for "I have too much to do"."""
        detail = answer.json()["detail"] if answer.is_problem() else "no problem"
        self.later[f"{route}: {detail}"] += 1
        if not any(words in detail for words in LOAD):
            self.fail(f"{name}: 503, and not for load: {detail}")
        elif "retry-after" not in answer.headers:
            self.fail(f"{name}: 503 without Retry-After")

    def judge(self, attack: Attack, outcome: Outcome) -> None:
        """An attack's outcome."""
        is_head = bytes(attack.pieces[0][:4]) == b"HEAD" if isinstance(attack.pieces[0], bytes) else False
        final = [answer for answer in outcome.answers if answer.status >= 200]
        for answer in final:
            self.judge_answer(attack.name, answer, is_head=is_head)
        if attack.leaves:
            return
        if not final:
            if not outcome.closed:
                self.fail(f"{attack.name}: silence for {outcome.seconds:.0f} s")
            elif "closed" not in attack.expect:
                self.fail(f"{attack.name}: hung up without an answer")
            else:
                self.statuses["closed"] += 1
            return
        for answer in final:
            wanted = [beginning for beginning in attack.expect if str(answer.status).startswith(beginning)]
            if not wanted and answer.status < 500:
                self.fail(f"{attack.name}: {answer.status}, not one of {', '.join(attack.expect)}")
