// The contract's shapes, as far as the console reads them. Units are metres and radians.

export type Status = "accepted" | "running" | "successful" | "failed" | "dismissed";
export const STATUSES: Status[] = ["accepted", "running", "successful", "failed", "dismissed"];

export interface Page<T> {
  items: T[];
  next_cursor: string | null;
}

export interface Progress {
  percent: number;
  stage: string;
  iteration: number;
  max_iterations: number;
  objective?: number | null;
}

export interface Job {
  id: string;
  name: string | null;
  labels: Record<string, string>;
  status: Status;
  progress: Progress;
  message: string | null;
  created: string | null;
  started: string | null;
  finished: string | null;
  updated: string | null;
  attempt: number;
  priority: number;
  map_id: string | null;
  problem: { title: string; detail: string; status: number; type: string } | null;
  links: Record<string, string>;
  retry_of?: string | null;
  parts?: { total: number; done: number; running: number } | null;
}

export type Kind = "propagated" | "posterior";
export type Distance = "sdf" | "vdf";
export type Point = [x: number, y: number];

export interface Lattice {
  origin: Point;
  resolution: number;
  cells: [nx: number, ny: number];
  control_points: [number, number];
}

export interface MapRecord {
  id: string;
  job_id: string;
  name: string | null;
  labels: Record<string, string>;
  created: string | null;
  distance: Distance;
  frame_id: string;
  lattice: Lattice;
  fit: {
    converged: boolean;
    unconverged?: string | null;
    iterations: number;
    observations: number;
    seconds: number;
    seen_through?: number | null;
    weighting: string;
  };
  links: Record<string, string>;
  parent?: string | null;
  version?: number;
}

export interface Pose {
  x: number;
  y: number;
  theta: number;
}

export interface FittedPoses {
  treatment: "fixed" | "refined";
  poses: { pose: Pose; covariance: number[] | null; posterior_covariance: number[] | null }[];
}

export interface Scan {
  pose: Pose;
  pose_covariance?: number[] | null;
  angle_min: number;
  angle_increment: number;
  range_min: number;
  range_max: number;
  ranges: (number | null)[];
}

export interface Noise {
  sigma_x: number;
  sigma_y: number;
  sigma_theta: number;
  sigma_range: number;
}

export interface JobRequest {
  name?: string | null;
  labels?: Record<string, string> | null;
  scans: Scan[];
  noise: Noise;
  map: { distance: Distance; resolution: number; bounds?: { min: Point; max: Point } | null; margin?: number | null };
  fit?: Record<string, unknown> | null;
  priority?: number | null;
}

/** What the service makes of points, in their order. */
export interface Answers {
  kind: Kind;
  distance: (number | null)[];
  sigma: (number | null)[];
  gradient?: (Point | null)[];
  nearest?: (Point | null)[];
  clearance?: (number | null)[];
  observed?: (boolean | null)[];
}

export interface Estimate {
  lattice: Lattice;
  control_points: number;
  scans?: number;
  returns: number;
  estimate: { seconds: number; bytes: number };
  /** Of a recording, whose scans the service reads. */
  preview?: { returns: Point[]; poses: Point[] };
}

export interface Place {
  name: string;
  version: number;
  map_id: string;
  published: string;
  note?: string | null;
  links?: Record<string, string>;
}

/** Where a scan was taken, as the map has it; no pose where it fits nowhere. */
export interface LocatedScan {
  pose: Pose | null;
  /** Row-major in (x, y, theta), the map's own uncertainty included. */
  covariance: number[] | null;
  converged: boolean;
  used: number;
  left_out: number;
  chi_squared: number;
  degrees_of_freedom: number;
  hypotheses: { pose: Pose; probability: number }[];
}

/** Where a map that was joined lies in the joined frame. */
export interface Frame {
  map_id: string;
  pose: Pose;
  /** Row-major in (x, y, theta); nought of the first, which is held. */
  covariance: number[];
}
