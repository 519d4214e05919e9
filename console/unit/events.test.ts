import { expect, test } from "vitest";
import { EventParser } from "../src/service/events";

test("events come whole, however the stream is cut", () => {
  const text =
    'event: progress\r\nid: 3\r\ndata: {"percent":1}\r\n\r\n: alive\n\nevent: status\nid: 4\ndata: {"a":\ndata: 1}\n\n';
  for (const size of [1, 2, 7, text.length]) {
    const parser = new EventParser();
    const events = [];
    for (let at = 0; at < text.length; at += size) events.push(...parser.push(text.slice(at, at + size)));
    expect(events).toEqual([
      { event: "progress", id: "3", data: '{"percent":1}' },
      { event: "status", id: "4", data: '{"a":\n1}' },
    ]);
  }
});
