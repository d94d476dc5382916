// Draws the shapes of a moving picture (rig.web.picture) on a canvas: solids in perspective, the far ones first.
//
// Which of two solids is nearer is decided by the plane of a face that keeps them apart best: the solid on the eye's side of
// that plane hides the other. It needs neither a GPU nor a buffer of depths.

const FIELD = 0.52; // tangent of half the angle of view
const SIDES = 24; // of a cylinder
const LIGHT = [-0.35, -0.5, 0.79];
const PLAIN = [150, 158, 170];

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const size = Math.hypot(...a) || 1; return a.map((one) => one / size); };
const numbers = (value) => (Array.isArray(value) ? value.every(numbers) : value !== null);

/** `point` turned by a quaternion (x, y, z, w). */
function turned([x, y, z, w], point) {
  const axis = [x, y, z], t = cross(axis, point).map((one) => 2 * one);
  return add(add(point, t.map((one) => w * one)), cross(axis, t));
}

export class Solids {
  /** `still`: camera and shapes that never change, as the server describes them. */
  constructor(still) {
    this.eye = still.eye;
    this.forward = unit(sub(still.target, still.eye));
    this.right = unit(cross(this.forward, [0, 0, 1]));
    this.up = cross(this.right, this.forward);
    this.shapes = new Map(); // path -> {kind, fields}
    this.places = new Map(); // path -> {translation, quaternion}
    this.text = "";
    for (const [path, kind, fields] of still.shapes) {
      this.shapes.set(path, { kind, fields: { ...this.shapes.get(path)?.fields, ...fields } });
    }
  }

  /** Take over what has moved: path -> fields. */
  move(frame) {
    for (const [path, fields] of Object.entries(frame)) {
      if (fields.labels) { [this.text] = fields.labels; continue; }
      const { translation, quaternion, ...others } = fields;
      if (translation || quaternion) this.places.set(path, { ...this.places.get(path), ...(translation && { translation }), ...(quaternion && { quaternion }) });
      if (!Object.keys(others).length) continue;
      const kind = this.shapes.get(path)?.kind ?? (others.strips ? "LineStrips3D" : others.vectors ? "Arrows3D" : "Points3D");
      this.shapes.set(path, { kind, fields: { ...this.shapes.get(path)?.fields, ...others } });
    }
  }

  /** Where the points of a path are. */
  #placed(path) {
    const steps = [];
    for (let above = path; above; above = above.slice(0, Math.max(above.lastIndexOf("/"), 0))) {
      const place = this.places.get(above);
      if (place && numbers([place.translation ?? [], place.quaternion ?? []])) steps.push(place);
    }
    return (point) => steps.reduce((p, { translation, quaternion }) =>
      add(quaternion ? turned(quaternion, p) : p, translation ?? [0, 0, 0]), point);
  }

  draw({ pen, width, height }) {
    const focal = Math.min(height, width / 1.25) / 2 / FIELD;
    const project = (point) => {
      const from = sub(point, this.eye), depth = Math.max(dot(from, this.forward), 1e-3);
      return [width / 2 + (focal * dot(from, this.right)) / depth, height / 2 - (focal * dot(from, this.up)) / depth, depth];
    };
    const things = [];
    for (const [path, { kind, fields }] of this.shapes) {
      if (makes[kind] && numbers(Object.values(fields))) things.push(...makes[kind](fields, this.#placed(path)));
    }
    for (const thing of things) {
      thing.seen = thing.points.map(project);
      for (const i of [0, 1]) {
        const along = thing.seen.map((one) => one[i]);
        (thing.box ??= [])[i] = [Math.min(...along), Math.max(...along)];
      }
      thing.depth = thing.seen.reduce((sum, one) => sum + one[2], 0) / thing.seen.length;
    }
    for (const thing of this.#ordered(things)) thing.draw(pen, thing, focal, this.eye);
  }

  /** The far ones first. */
  #ordered(things) {
    const rest = things.sort((a, b) => b.depth - a.depth), hidden = new Map(rest.map((one) => [one, []]));
    rest.forEach((a, i) => rest.slice(i + 1).forEach((b) => {
      if ([0, 1].some((k) => a.box[k][1] < b.box[k][0] || b.box[k][1] < a.box[k][0])) return;
      const later = this.#nearer(a, b) ? a : b;
      hidden.get(later).push(later === a ? b : a); // what it hides is drawn before
    }));
    const found = [], state = new Map();
    const visit = (one) => {
      if (state.has(one)) return;
      state.set(one, true);
      hidden.get(one).forEach(visit);
      found.push(one);
    };
    rest.forEach(visit);
    return found;
  }

  /** Whether `a` may hide `b`. */
  #nearer(a, b) {
    let best = -Infinity, answer = a.depth < b.depth;
    for (const [one, other] of [[a, b], [b, a]]) {
      for (const { normal, points: [first] } of one.faces) {
        const apart = Math.min(...other.points.map((point) => dot(normal, sub(point, first))));
        if (apart > best + 1e-9) {
          best = apart;
          answer = (dot(normal, sub(this.eye, first)) > 0) === (other === a);
        }
      }
    }
    return answer;
  }
}

function colour(rgb, bright = 1) { return `rgb(${rgb.slice(0, 3).map((one) => Math.round(Math.min(one * bright, 255))).join()})`; }

const of = (list, i) => list?.[i] ?? list?.[list.length - 1];

/** A convex solid with faces given by indices of its points. */
function solid(points, faces, rgb) {
  const middle = points.reduce(add, [0, 0, 0]).map((one) => one / points.length);
  const made = faces.map((indices) => {
    const corners = indices.map((i) => points[i]);
    let normal = unit(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])));
    if (dot(normal, sub(corners[0], middle)) < 0) normal = normal.map((one) => -one);
    return { indices, points: corners, normal };
  });
  return { points, faces: made, rgb, draw: drawSolid };
}

function drawSolid(pen, { seen, faces, rgb }, focal, eye) {
  for (const { indices, normal, points: [first] } of faces) {
    if (dot(normal, sub(eye, first)) <= 0) continue;
    pen.fillStyle = pen.strokeStyle = colour(rgb, 0.62 + 0.45 * Math.max(dot(normal, LIGHT), -0.5));
    pen.lineWidth = 0.8; // closes the seams between faces
    pen.beginPath();
    indices.forEach((i, k) => (k ? pen.lineTo(seen[i][0], seen[i][1]) : pen.moveTo(seen[i][0], seen[i][1])));
    pen.closePath();
    pen.fill();
    pen.stroke();
  }
}

function drawLine(pen, { seen, rgb, radius }, focal) {
  pen.strokeStyle = colour(rgb);
  pen.lineWidth = Math.max((2 * radius * focal) / seen[0][2], 1.2);
  pen.lineJoin = pen.lineCap = "round";
  pen.beginPath();
  seen.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}

function drawArrow(pen, thing, focal) {
  const [[x, y, depth], [u, v]] = thing.seen, length = Math.hypot(u - x, v - y);
  const wide = Math.max((2 * thing.radius * focal) / depth, 2.5), head = Math.min(3 * wide, length);
  if (length < 1.5) return;
  const [dx, dy] = [(u - x) / length, (v - y) / length], [nx, ny] = [u - head * dx, v - head * dy];
  pen.strokeStyle = pen.fillStyle = colour(thing.rgb);
  pen.lineWidth = wide;
  pen.lineCap = "butt";
  pen.beginPath();
  pen.moveTo(x, y); pen.lineTo(nx, ny);
  pen.stroke();
  pen.beginPath();
  pen.moveTo(u, v); pen.lineTo(nx - 1.1 * wide * dy, ny + 1.1 * wide * dx); pen.lineTo(nx + 1.1 * wide * dy, ny - 1.1 * wide * dx);
  pen.fill();
}

function drawPoint(pen, { seen: [[x, y, depth]], rgb, radius }, focal) {
  pen.fillStyle = colour(rgb);
  pen.beginPath();
  pen.arc(x, y, Math.max((radius * focal) / depth, 1), 0, 2 * Math.PI);
  pen.fill();
}

const BOX = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
const ROUND = Array.from({ length: SIDES }, (_, i) => [Math.cos((2 * Math.PI * i) / SIDES), Math.sin((2 * Math.PI * i) / SIDES)]);
const PRISM = [ROUND.map((_, i) => 2 * i), ROUND.map((_, i) => 2 * i + 1),
  ...ROUND.map((_, i) => [2 * i, 2 * i + 1, (2 * i + 3) % (2 * SIDES), (2 * i + 2) % (2 * SIDES)])];

const makes = {
  Boxes3D: ({ half_sizes: halves, centers, quaternions, colors }, placed) => (halves ?? []).map((half, i) => {
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => half.map((size, axis) => ((k >> (2 - axis)) & 1 ? size : -size)));
    const turn = of(quaternions, i), centre = of(centers, i) ?? [0, 0, 0];
    return solid(corners.map((one) => placed(add(turn ? turned(turn, one) : one, centre))), BOX, of(colors, i) ?? PLAIN);
  }),
  Cylinders3D: ({ lengths, radii, centers, quaternions, colors }, placed) => lengths.map((length, i) => {
    const radius = of(radii, i), turn = of(quaternions, i), centre = of(centers, i) ?? [0, 0, 0];
    const rim = ROUND.flatMap(([c, s]) => [-0.5, 0.5].map((end) => [radius * c, radius * s, end * length]));
    return solid(rim.map((one) => placed(add(turn ? turned(turn, one) : one, centre))), PRISM, of(colors, i) ?? PLAIN);
  }),
  LineStrips3D: ({ strips, colors, radii }, placed) => strips.map((strip, i) =>
    ({ points: strip.map(placed), faces: [], rgb: of(colors, i) ?? PLAIN, radius: of(radii, i) ?? 0.01, draw: drawLine })),
  Arrows3D: ({ vectors, origins, colors, radii }, placed) => (vectors ?? []).map((vector, i) => {
    const origin = of(origins, i) ?? [0, 0, 0];
    return { points: [placed(origin), placed(add(origin, vector))], faces: [], rgb: of(colors, i) ?? PLAIN, radius: of(radii, i), draw: drawArrow };
  }),
  Points3D: ({ positions, colors, radii }, placed) => positions.map((one, i) =>
    ({ points: [placed(one)], faces: [], rgb: of(colors, i) ?? PLAIN, radius: of(radii, i) ?? 0.02, draw: drawPoint })),
  Mesh3D: ({ vertex_positions: corners, triangle_indices: triangles, vertex_colors: colors }, placed) => {
    const points = corners.map(placed);
    return [{ points, faces: [], draw: (pen, { seen }) => {
      for (const [a, b, c] of triangles) {
        pen.fillStyle = pen.strokeStyle = colour(of(colors, a) ?? PLAIN);
        pen.lineWidth = 0.6;
        pen.beginPath();
        [a, b, c].forEach((i, k) => (k ? pen.lineTo(seen[i][0], seen[i][1]) : pen.moveTo(seen[i][0], seen[i][1])));
        pen.closePath();
        pen.fill();
        pen.stroke();
      }
    } }];
  },
};
