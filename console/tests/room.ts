// A room of 6 by 4 metres, scanned from a few places; exact rays, so that the test knows where its walls are.

interface Options {
  name: string;
  labels?: Record<string, string>;
  /** With a piece of wall in the middle. */
  door?: boolean;
  scans?: number;
  beams?: number;
  resolution?: number;
}

type Wall = [x0: number, y0: number, x1: number, y1: number];

export function room({ name, labels = {}, door = false, scans = 4, beams = 181, resolution = 0.25 }: Options) {
  const walls: Wall[] = [
    [0, 0, 6, 0],
    [6, 0, 6, 4],
    [6, 4, 0, 4],
    [0, 4, 0, 0],
    ...(door ? ([[3, 1.5, 3, 2.5]] as Wall[]) : []),
  ];
  const poses = Array.from({ length: scans }, (_, k) => {
    const turn = (2 * Math.PI * k) / scans;
    return { x: 3 + 1.8 * Math.cos(turn + 0.4), y: 2 + 1.1 * Math.sin(turn + 0.4), theta: turn };
  });
  const step = (2 * Math.PI) / beams;
  return {
    name,
    labels,
    scans: poses.map((pose) => ({
      pose,
      angle_min: -Math.PI,
      angle_increment: step,
      range_min: 0.05,
      range_max: 20,
      ranges: Array.from({ length: beams }, (_, k) => cast(walls, pose.x, pose.y, pose.theta - Math.PI + k * step)),
    })),
    noise: { sigma_x: 0.01, sigma_y: 0.01, sigma_theta: 0.003, sigma_range: 0.01 },
    map: { distance: "sdf", resolution },
  };
}

function cast(walls: Wall[], x: number, y: number, bearing: number): number {
  const [dx, dy] = [Math.cos(bearing), Math.sin(bearing)];
  const hits = walls.map(([x0, y0, x1, y1]) => {
    const [ex, ey] = [x1 - x0, y1 - y0];
    const cross = dx * ey - dy * ex;
    const range = ((x0 - x) * ey - (y0 - y) * ex) / cross;
    const along = ((x0 - x) * dy - (y0 - y) * dx) / cross;
    return range > 0 && along >= 0 && along <= 1 ? range : Infinity;
  });
  return Math.round(Math.min(...hits) * 1e4) / 1e4;
}

/** The same as a CARMEN log: 180 beams over the half turn ahead, every tenth of which meets nothing. */
export function carmen(scans = 6): string {
  const { scans: full } = room({ name: "", scans, beams: 360 });
  return full
    .map(
      ({ pose, ranges }) =>
        `FLASER 180 ${ranges
          .slice(90, 270)
          .map((range, k) => (k % 10 ? range : 81.83))
          .join(" ")} ${pose.x} ${pose.y} ${pose.theta} ${pose.x} ${pose.y} ${pose.theta} 0 host 0`,
    )
    .join("\n");
}
