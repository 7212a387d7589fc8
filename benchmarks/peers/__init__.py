"""Other programs on the benchmark scenes: error against time."""

from benchmarks.peers.acausal_peer import Acausal
from benchmarks.peers.base import AbstractPeer
from benchmarks.peers.casadi_peer import Casadi
from benchmarks.peers.diffrax_peer import Diffrax
from benchmarks.peers.drake_peer import Drake
from benchmarks.peers.exudyn_peer import Exudyn
from benchmarks.peers.heyoka_peer import Heyoka
from benchmarks.peers.mujoco_peer import Mujoco
from benchmarks.peers.scipy_peer import Scipy
from benchmarks.peers.sundae_peer import Sundae

PEERS: tuple[AbstractPeer, ...] = (Acausal(), Scipy(), Casadi(), Sundae(), Diffrax(), Heyoka(), Mujoco(), Drake(), Exudyn())
