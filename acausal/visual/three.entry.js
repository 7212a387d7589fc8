export { Scene, PerspectiveCamera, WebGLRenderer, Group, Mesh, BufferGeometry, BufferAttribute, Float32BufferAttribute, MeshStandardMaterial,
  BoxGeometry, SphereGeometry, CylinderGeometry, TorusGeometry, PlaneGeometry, DirectionalLight, HemisphereLight, Color, Vector2, Vector3, Quaternion,
  Fog, LineSegments, LineBasicMaterial, Raycaster, ShadowMaterial, PCFShadowMap, DoubleSide } from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
export { Line2 } from 'three/examples/jsm/lines/Line2.js';
export { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
export { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
