"use strict";
// Plays DATA (see animation.py): bodies, links, joints and trails over time. Exposes window.acausal for tests.
(function () {
  const byId = (id) => document.getElementById(id);
  function fail(message) {
    byId("error").style.display = "block";
    byId("error").textContent = message;
    window.acausal = { ready: false, error: message };
  }
  window.addEventListener("error", (event) => fail("The page has an error: " + event.message));

  const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const times = unpack(DATA.times), frames = times.length, first = times[0], last = times[frames - 1];
  const vector = (array, i) => new THREE.Vector3(array[3 * i], array[3 * i + 1], array[3 * i + 2]);
  const low = new THREE.Vector3(...DATA.low), high = new THREE.Vector3(...DATA.high), up = new THREE.Vector3(...DATA.up).normalize();
  const centre = low.clone().add(high).multiplyScalar(0.5), size = Math.max(low.distanceTo(high), 1e-6);
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (problem) {
    fail("This browser cannot draw in 3-D (WebGL is off). Try another browser, or switch hardware acceleration on.");
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  document.body.prepend(renderer.domElement);

  const scene = new THREE.Scene();
  scene.background = new THREE.Color(dark ? "#12171e" : "#eef2f6");
  scene.add(new THREE.HemisphereLight(0xffffff, dark ? 0x27313d : 0xb8c4d0, dark ? 1.5 : 1.9));
  const side = Math.abs(up.x) < 0.9 ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 1, 0);
  const right = new THREE.Vector3().crossVectors(up, side).normalize();
  const sun = new THREE.DirectionalLight(0xffffff, 2.2);
  sun.position.copy(centre).addScaledVector(up, 2.2 * size).addScaledVector(side, 0.7 * size).addScaledVector(right, -1.1 * size);
  sun.target.position.copy(centre);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  Object.assign(sun.shadow.camera, { left: -size, right: size, top: size, bottom: -size, near: 0.01 * size, far: 6 * size });
  sun.shadow.radius = 4;
  sun.shadow.normalBias = 0.003 * size;
  scene.add(sun, sun.target);

  // the ground: a grid below the whole motion
  let floor = Infinity;
  for (const x of [low.x, high.x]) for (const y of [low.y, high.y]) for (const z of [low.z, high.z]) floor = Math.min(floor, new THREE.Vector3(x, y, z).dot(up));
  const ground = centre.clone().addScaledVector(up, floor - centre.dot(up) - 0.004 * size);
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), up);
  const cell = Math.pow(10, Math.floor(Math.log10(size / 3)));
  const cells = Math.min(200, 2 * Math.ceil((1.6 * size) / cell));
  const grid = new THREE.GridHelper(cells * cell, cells, dark ? 0x4a5a6c : 0xb3c0cd, dark ? 0x27323e : 0xd7dfe7);
  grid.quaternion.copy(turn);
  grid.position.copy(ground);
  const shade = new THREE.Mesh(new THREE.PlaneGeometry(8 * size, 8 * size), new THREE.ShadowMaterial({ opacity: dark ? 0.45 : 0.16 }));
  shade.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), up);
  shade.position.copy(ground).addScaledVector(up, -1e-3 * size);
  shade.receiveShadow = true;
  scene.add(grid, shade);

  const thin = 0.011 * size;
  const material = (colour) => new THREE.MeshStandardMaterial({ color: colour, roughness: 0.55, metalness: 0.08 });
  function bar(a, b, radius, look) {
    const along = b.clone().sub(a), mesh = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, along.length(), 20), look);
    mesh.position.copy(a).addScaledVector(along, 0.5);
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
    return mesh;
  }
  function solid(shape, look) {
    const group = new THREE.Group(), add = (mesh) => (group.add(mesh), mesh);
    const axis = new THREE.Vector3(...(shape.axis || [0, 0, 1])).normalize();
    const toAxis = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), axis);
    if (shape.kind === "Box") add(new THREE.Mesh(new THREE.BoxGeometry(...shape.size), look));
    else if (shape.kind === "Sphere") banded(add, new THREE.SphereGeometry(shape.radius, 40, 24), look, shape.radius);
    else if (shape.kind === "PointMass") add(new THREE.Mesh(new THREE.SphereGeometry(2.2 * thin, 28, 18), look));
    else if (shape.kind === "Ellipsoid") {
      const mesh = banded(add, new THREE.SphereGeometry(1, 40, 24), look, 1);
      group.scale.set(...shape.semi_axes);
      mesh.castShadow = true;
    } else if (shape.kind === "Cylinder") add(new THREE.Mesh(new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 48), look)).quaternion.copy(toAxis);
    else if (shape.kind === "Disk") {
      add(new THREE.Mesh(new THREE.CylinderGeometry(shape.radius, shape.radius, shape.thickness, 64), look)).quaternion.copy(toAxis);
      const mark = material(new THREE.Color(look.color).multiplyScalar(0.55));
      const spoke = add(new THREE.Mesh(new THREE.BoxGeometry(1.7 * shape.radius, 1.06 * shape.thickness, 0.09 * shape.radius), mark));
      spoke.quaternion.copy(toAxis);
    } else if (shape.kind === "Rod") {
      const a = new THREE.Vector3(...shape.start), b = new THREE.Vector3(...shape.end), radius = shape.radius || Math.min(thin, 0.12 * a.distanceTo(b));
      add(bar(a, b, radius, look));
      for (const end of [a, b]) add(new THREE.Mesh(new THREE.SphereGeometry(radius * 1.5, 20, 14), look)).position.copy(end);
    } else if (shape.kind === "Polygon") plate(shape.points.map((p) => new THREE.Vector3(...p)), add, look);
    group.traverse((item) => { if (item.isMesh) item.castShadow = item.receiveShadow = true; });
    return group;
  }
  function banded(add, geometry, look, radius) {
    const mesh = add(new THREE.Mesh(geometry, look));
    const mark = material(new THREE.Color(look.color).multiplyScalar(0.55));
    for (const flip of [0, Math.PI / 2]) add(new THREE.Mesh(new THREE.TorusGeometry(1.002 * radius, 0.018 * radius, 8, 72), mark)).rotation.y = flip;
    return mesh;
  }
  function plate(points, add, look) {
    for (let i = 0; i < points.length; i++) {
      const a = points[i], b = points[(i + 1) % points.length];
      if ((points.length > 2 || i === 0) && a.distanceTo(b) > 1e-9 * size) add(bar(a, b, 0.7 * thin, look));
      add(new THREE.Mesh(new THREE.SphereGeometry(thin, 18, 12), look)).position.copy(a);
    }
    if (points.length < 3) return;
    const corners = [], geometry = new THREE.BufferGeometry();
    for (let i = 1; i + 1 < points.length; i++) corners.push(...points[0].toArray(), ...points[i].toArray(), ...points[i + 1].toArray());
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    geometry.computeVertexNormals();
    const glass = look.clone();
    Object.assign(glass, { transparent: true, opacity: 0.38, side: THREE.DoubleSide, depthWrite: false });
    add(new THREE.Mesh(geometry, glass));
  }

  const named = [];
  const bodies = DATA.bodies.map((body, i) => {
    const group = new THREE.Group(), colour = DATA.palette[i % DATA.palette.length];
    for (const shape of body.shapes) group.add(solid(shape, material(colour)));
    group.traverse((item) => { if (item.isMesh) { item.userData.name = body.name; named.push(item); } });
    scene.add(group);
    return { group, p: unpack(body.p), q: unpack(body.q), name: body.name, colour };
  });
  const metal = material(dark ? "#aab6c4" : "#5b6774");
  const joints = DATA.joints.map((joint) => {
    const ball = joint.kind === "ball" || joint.kind === "other";
    const geometry = ball ? new THREE.SphereGeometry(1.7 * thin, 22, 16) : joint.kind === "slider" ? new THREE.BoxGeometry(3 * thin, 7 * thin, 3 * thin) : new THREE.CylinderGeometry(1.7 * thin, 1.7 * thin, 4.2 * thin, 26);
    const mesh = new THREE.Mesh(geometry, metal);
    mesh.castShadow = true;
    mesh.userData.name = joint.name;
    named.push(mesh);
    scene.add(mesh);
    return { mesh, p: unpack(joint.p), axis: unpack(joint.axis) };
  });
  class Coil extends THREE.Curve {
    getPoint(s) { // along +y from 0 to 1; ends straight
      const turns = 10, lead = 0.12, inside = Math.min(1, Math.max(0, (s - lead) / (1 - 2 * lead))), r = s < lead || s > 1 - lead ? 0 : 1;
      return new THREE.Vector3(r * Math.cos(2 * Math.PI * turns * inside), s, r * Math.sin(2 * Math.PI * turns * inside));
    }
  }
  const links = DATA.links.map((link) => {
    const spring = link.kind === "spring", wide = 2.0 * thin;
    const look = material(spring ? (dark ? "#c9d3de" : "#3d4957") : "#8a63c4");
    let mesh;
    if (spring) {
      const curve = new Coil(), points = curve.getPoints(260).map((p) => new THREE.Vector3(p.x * wide, p.y, p.z * wide));
      mesh = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: look.color }));
    } else mesh = new THREE.Mesh(new THREE.CylinderGeometry(0.35 * thin, 0.35 * thin, 1, 10).translate(0, 0.5, 0), look);
    mesh.userData.name = link.name;
    if (mesh.isMesh) named.push(mesh);
    scene.add(mesh);
    return { mesh, a: unpack(link.a), b: unpack(link.b) };
  });
  const trails = DATA.trails.map((trail) => {
    const points = unpack(trail.p), geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
    const owner = bodies.find((body) => trail.name.startsWith(body.name));
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: owner ? owner.colour : "#888888", transparent: true, opacity: 0.75 }));
    line.frustumCulled = false;
    scene.add(line);
    return line;
  });

  byId("legend").replaceChildren(...bodies.slice(0, 24).map((body) => {
    const row = document.createElement("div"), swatch = document.createElement("i"), text = document.createElement("span");
    swatch.style.background = body.colour;
    text.textContent = body.name;
    row.append(swatch, text);
    return row;
  }));
  if (!bodies.length) byId("legend").style.display = "none";
  if (!trails.length) byId("trails").style.display = "none";

  const camera = new THREE.PerspectiveCamera(34, 1, 0.002 * size, 60 * size);
  camera.up.copy(up);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.enableDamping = true;
  function home() {
    let direction = new THREE.Vector3().addScaledVector(side, 0.62).addScaledVector(right, -1).addScaledVector(up, 0.42);
    if (DATA.normal) {
      const normal = new THREE.Vector3(...DATA.normal).normalize();
      if (normal.dot(direction) < 0) normal.negate();
      if (Math.abs(normal.dot(up)) > 0.95) { direction = normal.clone().addScaledVector(right, -0.02); }
      else direction = normal.clone().addScaledVector(up, 0.12);
    }
    const fit = (0.56 * size) / Math.tan((camera.fov * Math.PI) / 360) / Math.min(1, camera.aspect);
    camera.position.copy(centre).addScaledVector(direction.normalize(), fit);
    controls.target.copy(centre);
    controls.update();
  }
  function resize() {
    renderer.setSize(window.innerWidth, window.innerHeight);
    camera.aspect = window.innerWidth / window.innerHeight;
    camera.updateProjectionMatrix();
  }
  window.addEventListener("resize", resize);

  let now = first, playing = true, rate = DATA.speed, previous = null;
  const qa = new THREE.Quaternion(), qb = new THREE.Quaternion(), yAxis = new THREE.Vector3(0, 1, 0);
  function seek(t) {
    now = Math.min(last, Math.max(first, t));
    let i = 0, j = frames - 1;
    while (j - i > 1) { const k = (i + j) >> 1; if (times[k] <= now) i = k; else j = k; }
    const s = j > i && times[j] > times[i] ? (now - times[i]) / (times[j] - times[i]) : 0;
    for (const body of bodies) {
      body.group.position.lerpVectors(vector(body.p, i), vector(body.p, j), s);
      qa.set(body.q[4 * i + 1], body.q[4 * i + 2], body.q[4 * i + 3], body.q[4 * i]);
      qb.set(body.q[4 * j + 1], body.q[4 * j + 2], body.q[4 * j + 3], body.q[4 * j]);
      body.group.quaternion.slerpQuaternions(qa, qb, s);
    }
    for (const joint of joints) {
      joint.mesh.position.lerpVectors(vector(joint.p, i), vector(joint.p, j), s);
      joint.mesh.quaternion.setFromUnitVectors(yAxis, vector(joint.axis, i).lerp(vector(joint.axis, j), s).normalize());
    }
    for (const link of links) {
      const a = vector(link.a, i).lerp(vector(link.a, j), s), along = vector(link.b, i).lerp(vector(link.b, j), s).sub(a);
      link.mesh.position.copy(a);
      link.mesh.scale.set(1, Math.max(along.length(), 1e-9), 1);
      link.mesh.quaternion.setFromUnitVectors(yAxis, along.normalize());
    }
    for (const line of trails) line.geometry.setDrawRange(0, j + 1);
    byId("scrub").value = String((now - first) / Math.max(last - first, 1e-12));
    const digits = Math.max(2, Math.min(5, 3 - Math.floor(Math.log10(Math.max(last - first, 1e-9)))));
    byId("clock").textContent = now.toFixed(digits) + " s of " + last.toFixed(digits) + " s";
  }
  function setPlaying(value) { playing = value; byId("play").textContent = playing ? "Pause" : "Play"; }

  const factors = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];
  byId("speed").replaceChildren(...factors.map((factor) => {
    const option = document.createElement("option");
    option.value = String(factor * DATA.speed);
    const shown = factor * DATA.speed;
    option.textContent = (shown >= 0.01 ? String(Number(shown.toPrecision(3))) : shown.toExponential(1)) + " ×";
    option.selected = factor === 1;
    return option;
  }));
  byId("speed").onchange = (event) => { rate = Number(event.target.value); };
  byId("play").onclick = () => { if (now >= last) seek(first); setPlaying(!playing); };
  byId("scrub").oninput = (event) => { setPlaying(false); seek(first + Number(event.target.value) * (last - first)); };
  byId("reset").onclick = home;
  byId("trails").onclick = () => { for (const line of trails) line.visible = !line.visible; };
  window.addEventListener("keydown", (event) => { if (event.code === "Space" && event.target === document.body) { event.preventDefault(); byId("play").click(); } });
  const ray = new THREE.Raycaster(), pointer = new THREE.Vector2();
  renderer.domElement.addEventListener("pointermove", (event) => {
    pointer.set((2 * event.clientX) / window.innerWidth - 1, 1 - (2 * event.clientY) / window.innerHeight);
    ray.setFromCamera(pointer, camera);
    const hit = ray.intersectObjects(named, false)[0], tip = byId("tip");
    tip.style.display = hit ? "block" : "none";
    if (hit) { tip.textContent = hit.object.userData.name; tip.style.left = event.clientX + 14 + "px"; tip.style.top = event.clientY + 10 + "px"; }
  });

  function frame(clock) {
    requestAnimationFrame(frame);
    if (playing && previous !== null) seek(now >= last ? first : now + (rate * (clock - previous)) / 1000);
    previous = clock;
    controls.update();
    renderer.render(scene, camera);
  }
  resize();
  home();
  seek(first);
  window.acausal = { ready: true, bodies: bodies.length, seek: (t) => { setPlaying(false); seek(t); renderer.render(scene, camera); } };
  if (location.hash.startsWith("#t=")) window.acausal.seek(Number(location.hash.slice(3)));
  document.body.dataset.ready = "true";
  requestAnimationFrame(frame);
})();
