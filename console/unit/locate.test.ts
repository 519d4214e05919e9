import { expect, test } from "vitest";
import { agreement } from "../src/map/locate/list";
import { spread } from "../src/map/locate/scans";
import { sightings } from "../src/map/locate/sighting";
import type { Scan } from "../src/service/types";

const scan = (x: number): Scan => ({
  pose: { x, y: 0, theta: 0 },
  pose_covariance: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  angle_min: 0,
  angle_increment: 1,
  range_min: 0.1,
  range_max: 9,
  ranges: [1, null],
});
const picked = { indices: [0, 3, 6, 9, 12, 15], scans: [0, 3, 6, 9, 12, 15].map(scan), of: 18, noise: null };

test("scans are taken evenly over the file, never more than there are", () => {
  expect(spread(10, 4)).toEqual([0, 2, 5, 7]);
  expect(spread(3, 10)).toEqual([0, 1, 2]);
  expect(spread(5, 0)).toEqual([0]);
});

test("near the file's poses: a few scans a request, the panel's sigmas for the file's covariances", () => {
  const asked = sightings(picked, { sigma: { position: 0.2, heading: 0.1 } }, "posterior");
  expect(asked.map(({ indices }) => indices)).toEqual([[0, 3, 6, 9, 12], [15]]);
  const { scans, noise, kind, hypotheses } = asked[1]?.sighting ?? {};
  expect(noise).toEqual({ sigma_x: 0.2, sigma_y: 0.2, sigma_theta: 0.1, sigma_range: 0.02 });
  expect([kind, hypotheses]).toEqual(["posterior", 1]);
  expect(scans?.[0]).toMatchObject({ pose: { x: 15 }, ranges: [1, null] });
  expect(scans?.[0]).not.toHaveProperty("pose_covariance");
});

test("anywhere: scan by scan without a pose, and with the rivals of the best", () => {
  const asked = sightings(
    { ...picked, noise: { sigma_x: 1, sigma_y: 1, sigma_theta: 1, sigma_range: 0.05 } },
    { sigma: null },
    "propagated",
  );
  expect(asked).toHaveLength(6);
  expect(asked[2]?.sighting).toMatchObject({ scans: [{ pose: null }], noise: { sigma_range: 0.05 }, hypotheses: 3 });
});

test("agreement is told in one line", () => {
  const found = { used: 176, left_out: 4, chi_squared: 171.4, degrees_of_freedom: 173 };
  expect(agreement(found as never)).toBe("176 used, 4 left out; χ² 171 of 173.");
});
