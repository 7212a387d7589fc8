export { Scene, PerspectiveCamera, WebGLRenderer, Group, Mesh, Line, LineLoop, LineSegments, BufferGeometry, BufferAttribute, Float32BufferAttribute,
  MeshStandardMaterial, LineBasicMaterial, BoxGeometry, SphereGeometry, CylinderGeometry, TorusGeometry, PlaneGeometry, TubeGeometry, Curve,
  DirectionalLight, HemisphereLight, Color, Vector3, Quaternion, Matrix4, GridHelper, Raycaster, Vector2, ShadowMaterial, PCFShadowMap, SRGBColorSpace, Fog, DoubleSide, EdgesGeometry } from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
