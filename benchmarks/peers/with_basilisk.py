"""The testbed in Basilisk: a hub and four balanced reaction wheels in free space."""

from __future__ import annotations

import time

import numpy as np
from Basilisk.architecture import messaging  # type: ignore[import-not-found]  # lives in an environment of its own
from Basilisk.simulation import reactionWheelStateEffector, spacecraft, svIntegrators  # type: ignore[import-not-found]  # the same
from Basilisk.utilities import SimulationBaseClass, macros  # type: ignore[import-not-found]  # the same

from benchmarks.peers.conversation import Arrays, answer


def replay(asked: Arrays) -> Arrays:
    """Fly the torques (ticks, wheels) N m from `start`, [q_BN, omega_BN_B, omega_wheel]; the state at the end, with q_BN as sigma_BN.

    The hub has the inertia of the whole with wheels locked: a balanced wheel of Basilisk takes its spinning part out of it.
    """
    wheels, body = reactionWheelStateEffector.ReactionWheelStateEffector(), spacecraft.Spacecraft()
    q_BN, omega_BN_B, omega_wheel = np.split(asked["start"], [4, 7])
    for axis, speed in zip(asked["wheel_axes"].T, omega_wheel, strict=True):
        wheel = reactionWheelStateEffector.RWConfigPayload()  # without friction and limits unless told
        across = np.linalg.svd(axis[None])[2][1]
        wheel.gsHat_B, wheel.w2Hat0_B, wheel.w3Hat0_B = (v.reshape(3, 1).tolist() for v in (axis, across, np.cross(axis, across)))
        wheel.RWModel, wheel.Js, wheel.Omega = reactionWheelStateEffector.BalancedWheels, float(asked["wheel_inertia"]), float(speed)
        wheels.addReactionWheel(wheel)
    body.hub.mHub, body.hub.IHubPntBc_B = float(asked["mass"]), asked["inertia"].tolist()
    body.hub.sigma_BNInit = (q_BN[:3] / (1.0 + q_BN[3])).reshape(3, 1).tolist()
    body.hub.omega_BN_BInit = omega_BN_B.reshape(3, 1).tolist()
    body.addStateEffector(wheels)
    integrator = svIntegrators.svIntegratorRK4(body)
    body.setIntegrator(integrator)

    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("testbed").addTask(simulation.CreateNewTask("physics", macros.sec2nano(float(asked["step_s"]))))
    simulation.AddModelToTask("physics", wheels, 2)  # before the body, which then integrates up to now under the newest command
    simulation.AddModelToTask("physics", body, 1)
    command, payload = messaging.ArrayMotorTorqueMsg().write(messaging.ArrayMotorTorqueMsgPayload()), messaging.ArrayMotorTorqueMsgPayload()
    wheels.rwMotorCmdInMsg.subscribeTo(command)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(0)
    simulation.ExecuteSimulation()

    tick = macros.sec2nano(float(asked["tick_s"]))
    start = time.process_time()
    for k, torque in enumerate(asked["torque"]):
        payload.motorTorque = torque
        command.write(payload, k * tick)
        simulation.ConfigureStopTime((k + 1) * tick)
        simulation.ExecuteSimulation()
    seconds = time.process_time() - start
    hub, speeds = body.scStateOutMsg.read(), wheels.rwSpeedOutMsg.read().wheelSpeeds
    return {"seconds": np.array(seconds), "end": np.array([*hub.sigma_BN, *hub.omega_BN_B, *speeds[: len(omega_wheel)]])}


if __name__ == "__main__":
    answer({"replay": replay})
