"use strict";
// Meshes for the shapes of shapes.py and for links; `thin` is the radius [m] of what has none of its own.
function makeSolids(thin) {
  const Y = new THREE.Vector3(0, 1, 0), Z = new THREE.Vector3(0, 0, 1);
  const point = (p) => new THREE.Vector3(p[0], p[1], p[2]);
  const material = (colour) => new THREE.MeshStandardMaterial({ color: colour, roughness: 0.55, metalness: 0.06 });
  const darker = (look) => material(look.color.clone().multiplyScalar(0.5));
  const mesh = (geometry, look) => new THREE.Mesh(geometry, look);
  const from = (unit, axis) => new THREE.Quaternion().setFromUnitVectors(unit, point(axis).normalize());

  function bar(a, b, radius, look) {
    const along = b.clone().sub(a), made = mesh(new THREE.CylinderGeometry(radius, radius, along.length(), 24), look);
    made.position.copy(a).addScaledVector(along, 0.5);
    if (along.lengthSq() > 0) made.quaternion.setFromUnitVectors(Y, along.normalize());
    return made;
  }
  function ball(centre, radius, look) {
    const made = mesh(new THREE.SphereGeometry(radius, 28, 18), look);
    made.position.copy(centre);
    return made;
  }
  function banded(radius, look) { // two bands show how a ball turns
    const bands = [0, Math.PI / 2].map((turn) => {
      const band = mesh(new THREE.TorusGeometry(1.002 * radius, 0.02 * radius, 8, 72), darker(look));
      band.rotation.y = turn;
      return band;
    });
    return [mesh(new THREE.SphereGeometry(radius, 48, 28), look), ...bands];
  }
  function disk(shape, look) {
    const { radius, thickness } = shape, spoke = darker(look);
    const marks = [
      mesh(new THREE.BoxGeometry(1.7 * radius, 1.04 * thickness, 0.07 * radius), spoke),
      mesh(new THREE.CylinderGeometry(0.12 * radius, 0.12 * radius, 1.1 * thickness, 32), spoke),
    ];
    return [mesh(new THREE.CylinderGeometry(radius, radius, thickness, 72), look), ...marks];
  }
  function about(axis, meshes) { // cylinders of three.js stand on y
    for (const made of meshes) made.quaternion.copy(from(Y, axis));
    return meshes;
  }
  function rod(shape, look) {
    const a = point(shape.start), b = point(shape.end), own = shape.radius !== null;
    const radius = own ? shape.radius : Math.min(thin, 0.12 * a.distanceTo(b));
    return [bar(a, b, radius, look), ball(a, own ? radius : 1.5 * radius, look), ball(b, own ? radius : 1.5 * radius, look)];
  }
  function wire(shape, look) { // as thin as in geometry.py
    const points = shape.points.map(point), radius = shape.radius === null ? 0.3 * thin : shape.radius, made = [];
    for (let i = 0; i + 1 < points.length; i++) made.push(bar(points[i], points[i + 1], radius, look));
    return made;
  }
  function plate(shape, look) {
    const points = shape.points.map(point), made = points.map((p) => ball(p, thin, look));
    for (let i = 0; i < points.length; i++) {
      const next = points[(i + 1) % points.length];
      if ((points.length > 2 || i === 0) && points[i].distanceTo(next) > 0) made.push(bar(points[i], next, 0.7 * thin, look));
    }
    if (points.length > 2) made.push(sheet(points, look, 0.38));
    return made;
  }
  function sheet(points, look, opacity) {
    const corners = [], geometry = new THREE.BufferGeometry(), glass = look.clone();
    for (let i = 1; i + 1 < points.length; i++) for (const p of [points[0], points[i], points[i + 1]]) corners.push(p.x, p.y, p.z);
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    geometry.computeVertexNormals();
    Object.assign(glass, { transparent: true, opacity, side: THREE.DoubleSide, depthWrite: false });
    const made = mesh(geometry, glass);
    made.userData.noShadow = true;
    return made;
  }
  function plane(shape, look) { // along world axes where it can, as `plane_corners` in geometry.py
    const n = point(shape.normal).normalize(), sizes = [n.x, n.y, n.z].map(Math.abs), least = sizes.indexOf(Math.min(...sizes));
    const u = new THREE.Vector3().setComponent(least, 1), group = new THREE.Group();
    u.addScaledVector(n, -u.dot(n)).normalize();
    group.matrix.makeBasis(u, n.clone().cross(u), n);
    group.quaternion.setFromRotationMatrix(group.matrix);
    group.position.copy(point(shape.point));
    const sheet = mesh(new THREE.PlaneGeometry(shape.size, shape.size), look.clone()), half = shape.size / 2, cells = 8, ends = [];
    Object.assign(sheet.material, { transparent: true, opacity: 0.4, side: THREE.DoubleSide, depthWrite: false });
    sheet.userData.noShadow = true;
    for (let i = 0; i <= cells && shape.squares; i++) {
      const at = half * (2 * i / cells - 1);
      ends.push(at, -half, 0, at, half, 0, -half, at, 0, half, at, 0);
    }
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(ends, 3));
    group.add(sheet, new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: look.color.clone().multiplyScalar(0.8), transparent: true, opacity: 0.5 })));
    return [group];
  }
  function arrow(shape, look) { // proportions as `_arrow` in geometry.py
    const a = point(shape.start), along = point(shape.end).sub(a), length = along.length(), radius = Math.min(shape.radius === null ? 0.4 * thin : shape.radius, length / 18);
    const group = new THREE.Group(), head = upright(3.2 * radius, 0, 9 * radius, look);
    head.position.y = length - 9 * radius;
    group.add(upright(radius, radius, length - 9 * radius, look), head);
    group.position.copy(a);
    if (length > 0) group.quaternion.setFromUnitVectors(Y, along.divideScalar(length));
    return [group];
  }
  function ellipsoid(shape, look) {
    const meshes = banded(1, look), group = new THREE.Group();
    group.add(...meshes);
    group.scale.set(...shape.semi_axes);
    return [group];
  }
  const makers = {
    Box: (shape, look) => [mesh(new THREE.BoxGeometry(...shape.size), look)],
    Sphere: (shape, look) => banded(shape.radius, look),
    Cylinder: (shape, look) => about(shape.axis, [mesh(new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 56), look)]),
    Disk: (shape, look) => about(shape.axis, disk(shape, look)),
    Torus: (shape, look) => {
      const ring = mesh(new THREE.TorusGeometry(shape.radius, shape.tube, 20, 96), look);
      ring.quaternion.copy(from(Z, shape.axis));
      return [ring];
    },
    PointMass: (shape, look) => [ball(new THREE.Vector3(), shape.radius === null ? 2.2 * thin : shape.radius, look)],
    Ellipsoid: ellipsoid, Rod: rod, Arrow: arrow, Polygon: plate, Wire: wire, Plane: plane,
  };
  function solid(shape, colour) {
    const group = new THREE.Group(), R = shape.rotation;
    // a rotation's quaternion, from its axis in the frame: three.js wants columns
    const x = point([R[0][0], R[1][0], R[2][0]]), y = point([R[0][1], R[1][1], R[2][1]]), z = point([R[0][2], R[1][2], R[2][2]]);
    group.matrix.makeBasis(x, y, z);
    group.quaternion.setFromRotationMatrix(group.matrix);
    group.position.copy(point(shape.position));
    group.add(...makers[shape.kind](shape, material(shape.colour || colour)));
    group.traverse((item) => { if (item.isMesh) { item.castShadow = !item.userData.noShadow; item.receiveShadow = true; } });
    return group;
  }

  // a helix that stretches: its wire keeps its thickness, so the vertices follow the ends
  function coil(radius, wire, look) {
    const turns = 9, steps = 14 * turns, around = 7, lead = 0.1, positions = new Float32Array(3 * (steps + 1) * around), normals = new Float32Array(positions.length), index = [];
    for (let i = 0; i < steps; i++) for (let k = 0; k < around; k++) {
      const a = i * around + k, b = i * around + ((k + 1) % around);
      index.push(a, a + around, b, b, a + around, b + around);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
    geometry.setIndex(index);
    const made = mesh(geometry, look);
    made.frustumCulled = false;
    function stretch(length) { // along y from 0 to `length`
      for (let i = 0, at = 0; i <= steps; i++) {
        const s = i / steps, inside = Math.min(1, Math.max(0, (s - lead) / (1 - 2 * lead))), phase = 2 * Math.PI * turns * inside;
        const r = radius * Math.min(1, 8 * Math.min(inside, 1 - inside)), c = Math.cos(phase), d = Math.sin(phase);
        for (let k = 0; k < around; k++, at += 3) {
          const angle = (2 * Math.PI * k) / around, out = Math.cos(angle), high = Math.sin(angle);
          positions[at] = (r + wire * out) * c; positions[at + 1] = s * length + wire * high; positions[at + 2] = (r + wire * out) * d;
          normals[at] = out * c; normals[at + 1] = high; normals[at + 2] = out * d;
        }
      }
      geometry.attributes.position.needsUpdate = geometry.attributes.normal.needsUpdate = true;
      geometry.computeBoundingSphere();
    }
    return { object: made, stretch };
  }
  function upright(radiusLow, radiusHigh, length, look) { // stands on the origin
    return mesh(new THREE.CylinderGeometry(radiusHigh, radiusLow, length, 24).translate(0, length / 2, 0), look);
  }
  // objects along y that stretch(length) fits between two ends
  const linkMakers = {
    spring: (look, width) => coil(width, 0.28 * thin, look),
    string: (look) => {
      const line = upright(0.22 * thin, 0.22 * thin, 1, look);
      return { object: line, stretch: (length) => line.scale.set(1, length, 1) };
    },
    damper: (look, width, shortest, longest) => { // a cylinder of one length, unless the ends come closer than half of it
      const full = Math.max(0.2 * longest, Math.min(0.5 * longest, 0.7 * shortest)), group = new THREE.Group();
      const housing = upright(0.55 * width, 0.55 * width, full, look), shaft = upright(0.26 * width, 0.26 * width, 1, material("#c3ccd6"));
      group.add(housing, shaft);
      return { object: group, stretch: (length) => { shaft.scale.set(1, length, 1); housing.scale.set(1, Math.min(1, (0.7 * length) / full), 1); } };
    },
    force: (look) => {
      const group = new THREE.Group(), shaft = upright(0.45 * thin, 0.45 * thin, 1, look), head = upright(1.3 * thin, 0, 3.6 * thin, look);
      group.add(shaft, head);
      return { object: group, stretch: (length) => {
        const tip = Math.min(1, (0.5 * length) / (3.6 * thin));
        shaft.scale.set(1, Math.max(length - 3.6 * thin * tip, 1e-12), 1);
        head.scale.setScalar(tip);
        head.position.y = length - 3.6 * thin * tip;
      } };
    },
    cone: (look, width, shortest, longest, slope) => { // of friction, its tip at the contact
      const glass = look.clone();
      Object.assign(glass, { transparent: true, opacity: 0.25, side: THREE.DoubleSide, depthWrite: false });
      const made = mesh(new THREE.CylinderGeometry(slope, 0, 1, 48, 1, true).translate(0, 0.5, 0), glass);
      return { object: made, stretch: (length) => made.scale.setScalar(length) };
    },
  };
  function jointMesh(kind, look) {
    if (kind === "hinge") return mesh(new THREE.CylinderGeometry(1.7 * thin, 1.7 * thin, 4.2 * thin, 28), look);
    if (kind === "slider") return mesh(new THREE.BoxGeometry(3 * thin, 7 * thin, 3 * thin), look);
    return mesh(new THREE.SphereGeometry(1.7 * thin, 24, 16), look);
  }
  return { solid, material, linkMakers, jointMesh };
}
