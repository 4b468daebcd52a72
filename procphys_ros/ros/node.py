# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""Node `sim`: parameters in, a simulation that keeps real time, poses and markers out."""

from collections.abc import Callable
import sys
from time import monotonic
from traceback import format_exception

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from procphys_ros import progress
from procphys_ros.errors import SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.ros import simulation_interfaces
from procphys_ros.ros.activity import LongWork
from procphys_ros.ros.background_compilation import BackgroundCompilation
from procphys_ros.ros.building import Builder
from procphys_ros.ros.commands import Command, CommandQueue, describe
from procphys_ros.ros.diagnostics import Diagnostics, status_line
from procphys_ros.ros.lidar import LidarPublisher
from procphys_ros.ros.loading import Loading
from procphys_ros.ros.loop import Loop
from procphys_ros.ros.pacing import Pacer, RateLimiter, Speedometer
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.publishers import Publishers
from procphys_ros.ros.requests import Requests
from procphys_ros.ros.services import Answers, create_services
from procphys_ros.ros.session import REMEDY, Session
from procphys_ros.ros.topic_commands import TopicCommands
from procphys_ros.scene.parameter_table import GLOBAL, listing, OBJECT
from procphys_ros.scene.settings import read_settings, Settings

_STATUS_PERIOD = 1.0  # [s] between diagnostics
_LONGEST_TURN = 0.05  # [s] of steps between checks for commands
_LONGEST_REST = 0.25  # [s] between checks for late joiners while time stands still
_LAST_TURN = 0.3  # [s] that each of four threads may take to end; the node ends within 2 s
_WARNING_PERIOD = 1.0  # [s] least time between warnings about rejected commands


def _with_parameters(node: type[Node]) -> type[Node]:
    """Write the table of parameters into the docstring of a class."""
    rows = f'{listing(GLOBAL)}\n{listing(OBJECT, "<object>.")}'
    if node.__doc__:  # not under python -OO
        node.__doc__ = node.__doc__.replace('{parameters}', rows.lstrip())
    return node


@_with_parameters
class SimNode(Node):
    """
    Simulate a scene of trees and buildings and publish it on topics.

    Three threads share the work. One spins ROS: it checks parameters and serves services. One
    receives commands from topics. The third owns the simulation and takes turns: execute the
    commands of the single queue, run the steps that are due, publish. So the node answers during
    long steps, too. The node publishes /clock, so it never uses ROS time itself.

    Publishers (all reliable):
        ~/poses (geometry_msgs/PoseArray, depth 5): every part, in part order
        ~/markers (visualization_msgs/MarkerArray, depth 100): changes; the full set for a new
            subscriber
        ~/scene_description (std_msgs/String, depth 1, latched): objects, parts, bonds as JSON
        ~/ground (visualization_msgs/MarkerArray, depth 1, latched): terrain and paving of streets
        ~/breaks (sensor_msgs/PointCloud2, depth 100): a row per broken bond
        ~/broken_bonds (sensor_msgs/PointCloud2, depth 1, latched): all of them since the start
        ~/leaves (sensor_msgs/PointCloud2, depth 1, latched): a row per leaf: petiole on its part
        ~/leaf_poses (geometry_msgs/PoseArray, depth 5): petioles of all leaves, at `marker_rate`
        ~/dust (sensor_msgs/PointCloud2, depth 1): dust of bursting mortar and impacts
        ~/lidar (sensor_msgs/PointCloud2, depth 5): ranges of the sensor of `lidar.*`, as an image
        ~/wind_info (geometry_msgs/Vector3Stamped, depth 5): total wind at reference height
        ~/ground_motion (geometry_msgs/AccelStamped, depth 5): acceleration of the ground
        ~/joint_states (sensor_msgs/JointState, depth 5): hinges, sliders and ropes of mechanisms
        ~/intruder_wrench (geometry_msgs/WrenchStamped, depth 5): on the intruder, smoothed over
            0.1 s
        ~/intruders/<name>/wrench (geometry_msgs/WrenchStamped, depth 5): on a named one, likewise
        ~/ready (std_msgs/Bool, depth 1, latched): whether a scene is loaded
        /clock (rosgraph_msgs/Clock, depth 1): simulation time
        /tf (tf2_msgs/TFMessage, depth 100): a frame per object, if `publish_tf` and the package is
            installed
        /diagnostics (diagnostic_msgs/DiagnosticArray, depth 5): once a second

    Subscribers (all reliable, depth 10000; of a node `<name>_commands`, see `receiver.py`):
        ~/wind (geometry_msgs/Vector3Stamped): mean air velocity [m/s]
        ~/impulse (geometry_msgs/WrenchStamped): [N·s], [N·m·s] on the part header.frame_id
        ~/wrench (geometry_msgs/WrenchStamped): the same as a lasting force [N], [N·m]
        ~/explosion (geometry_msgs/PointStamped): position of a blast of `explosion.charge`
        ~/observer (geometry_msgs/PoseStamped): the camera for `culling.*`, looking along its x
        ~/intruder (geometry_msgs/PoseStamped): next pose of the body of `intruder.*`
        ~/intruders (geometry_msgs/PoseArray): the same for those of `intruders.names`, all at once
        ~/intruders/<name> (geometry_msgs/PoseStamped): the same for one of them
        ~/joint_command (sensor_msgs/JointState): position, velocity or effort of joints, by name
        ~/downwash (geometry_msgs/WrenchStamped): thrust [N] of the rotors of the intruder
            header.frame_id ('' = that of `intruder.*`), in its frame

    Services:
        ~/set_wind_enabled, ~/set_pause (std_srvs/SetBool)
        ~/gust, ~/apply_impulse, ~/launch_projectile, ~/explode, ~/demolish, ~/cut,
        ~/earthquake, ~/grow, ~/clear_wrenches, ~/step_simulation, ~/reset_simulation,
        ~/reload_scene, ~/cancel_reload, ~/save_state, ~/inspect, ~/restore_state, ~/spawn,
        ~/remove (std_srvs/Trigger)
        ~/simulation_interfaces/…, if that package is installed: see `simulation_interfaces.py`

    Parameters (default; unit; range; when a change takes effect):
        {parameters}

    :raises ProcPhysError: if the scene cannot be built.
    """

    def __init__(self, **options):
        super().__init__('sim', **options)
        try:
            self._set_up()
        except Exception:
            Node.destroy_node(self)  # else it would stay in the graph, without a scene
            raise

    def _set_up(self) -> None:
        self.parameters = Parameters(self)
        if not self.parameters['scene.objects']:
            raise SceneError('scene.objects is empty, there is nothing to simulate; give a scene '
                             f'with --ros-args --params-file {shared_folder()}/config/demo.yaml')
        # A node that publishes /clock must not wait for it: its timers run on a steady clock.
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.loop = Loop(self._turn, self.context)
        self.commands = CommandQueue(self.loop.wake, self._report_rejection)
        self._publish_rate = self.parameters['publish_rate']
        self._limiter = RateLimiter(self._publish_rate)
        self._lively_until = 0.0
        self._warnings = RateLimiter(1.0 / _WARNING_PERIOD)
        self.pacer = Pacer(self.parameters['time_step'], self.parameters['real_time_factor'],
                           budget=self._longest_turn())
        self.session = Session(self.pacer)
        self._compilation = BackgroundCompilation(self.get_logger().info)
        self.builder = Builder()
        self._output = Publishers(self, self.parameters['world_frame'], self.parameters)
        self._lidar = LidarPublisher(self, self.parameters)
        self.diagnostics = Diagnostics(self, self.commands, Speedometer(self.pacer),
                                       self.loop.activity, self.builder.activity,
                                       self._compilation)
        self._offer()
        self.session.on_scene = self._start_scene
        self.session.on_reset = lambda: self._output.reset(self.session.simulation)
        self.session.on_steps = self._show_steps
        self.session.on_weather = self.create_guard_condition(self._tell_weather).trigger
        self.parameters.on_change(self._change)
        self._moved = False
        self._start()

    def _offer(self) -> None:
        """Create the topics and services for commands."""
        frame = self.parameters['world_frame']
        requests = Requests(self.parameters, self.session)
        self.receiver = TopicCommands(self, self.commands, self.session, requests, frame,
                                      self.parameters['intruders.names']).receiver
        answers = Answers(self, self.commands, lambda: self.parameters['service_deadline'],
                          self.steady_clock)
        loading = Loading(self.builder, self.commands, self.parameters, self.session)
        create_services(self, answers, requests, loading)
        simulation_interfaces.offer(self, answers, self.session, loading.begin_spawn)
        self._loading, self._answers = loading, answers

    def _start(self) -> None:
        """Start all threads and timers."""
        self._warn_about_settings()
        say = self.get_logger().info
        self._watched = LongWork(self.loop.activity, say), LongWork(self.builder.activity, say)
        self._clocks = self._namesakes = 1
        self.has_told_end = False  # the process may do so instead, as `running` does
        self._unheard: set[str] = set()
        status = self.parameters['status_line']
        self._has_status_line = status == 'on' or (
            status == 'auto' and sys.stdout is not None and sys.stdout.isatty())
        self.create_timer(_STATUS_PERIOD, self._report, clock=self.steady_clock)
        self._compilation.start()
        self.receiver.start()
        self.loop.start()
        self._begin()

    def _begin(self) -> None:
        """Load the first scene."""
        self._loading.load_first(self.loop.fail)

    def destroy_node(self) -> bool:
        """
        End the simulation, then the node.

        :returns: whether all threads have ended; a computing one cannot be stopped.
        """
        self._compilation.close()
        ended = [thread.stop(_LAST_TURN)
                 for thread in (self.receiver, self.builder, self._loading, self.loop)]
        if all(ended):
            self._output.close()
            self.session.close()
            super().destroy_node()
        return all(ended)

    def _turn(self) -> float:
        """Execute commands, run the steps that are due, publish; return the time to wait [s]."""
        has_news = self.commands.drain() or self._output.has_late_joiners
        if not self.session.has_scene:
            return _LONGEST_TURN
        self._guard('a step', self._advance)
        self._choose_rate(has_news or not self.session.stands)
        self._guard('publishing', self._publish)
        if len(self.commands) or self.pacer.is_behind and not self.session.stands:
            return 0.0
        rests = self.session.stands and monotonic() >= self._lively_until
        return min(self._limiter.wait, _LONGEST_REST if rests else _LONGEST_TURN)

    def _choose_rate(self, has_news: bool) -> None:
        """Lower the publishing rate after a time of standstill."""
        if has_news:
            self._lively_until = monotonic() + _STATUS_PERIOD
        seldom = min(self._publish_rate, 1.0 / _STATUS_PERIOD)
        self._limiter.rate = self._publish_rate if monotonic() < self._lively_until else seldom

    def _advance(self) -> None:
        if not self.session.stands and self.pacer.advance(self._step,
                                                          lambda: self.commands.is_called):
            self._moved = True

    def _publish(self) -> None:
        is_due = self._limiter.is_due()
        if is_due or self._limiter.rate == self._publish_rate:
            self.diagnostics.look(self.session, self.pacer)
        if is_due:
            self._output.publish(self.session.simulation, self._moved)
            self._moved = False

    def _guard(self, what: str, act: Callable[[], None]) -> None:
        """Execute a function; after an error time stands still and the node goes on."""
        try:
            act()
        except Exception as error:
            if not self.context.ok():
                raise
            if not self.session.failure:
                self.session.fail(error)
                self.get_logger().error(f'{what} went wrong at {self.session.simulation.time:.3f} '
                                        f's: {self.session.failure}; {REMEDY}')
                self._log_traceback(error)

    def _step(self) -> None:
        with progress.stage('a step'):
            self.session.simulation.step()
            self._lidar.look(self.session.simulation)
        self.diagnostics.note(self.session.simulation.timings)

    def _show_steps(self) -> None:
        self._lidar.look(self.session.simulation)
        self._output.publish(self.session.simulation, True)

    def _start_scene(self) -> None:
        self._output.start_scene(self.session.simulation)
        self.get_logger().info(banner(self))

    def _longest_turn(self) -> float:
        return min(1.0 / self._publish_rate, _LONGEST_TURN)

    def _change(self, names: set[str]) -> None:
        """Apply changed parameters; they have been checked before."""
        groups = {name.split('.')[0] for name in names}
        settings = read_settings(self.parameters.nested()) if groups & {'wind', 'load'} else None
        self.commands.call(Command('set_parameters', lambda: self._apply(names, settings)))

    def _apply(self, names: set[str], settings: Settings | None) -> str:
        self._publish_rate = self.parameters['publish_rate']
        self.pacer.budget = self._longest_turn()
        if names & {'real_time_factor'}:
            self.pacer.factor = self.parameters['real_time_factor']
            self.pacer.restart()
        self._output.apply(names)
        self._lidar.apply(names)
        if settings is not None and self.session.has_scene:
            self.session.change_weather(settings, names)
        return f'{", ".join(sorted(names))} changed'

    def _tell_weather(self) -> None:
        """Set the parameters to the present wind and snow, whatever changed them."""
        session = self.session
        now = {'wind.velocity': list(session.mean_wind), 'load.snow': session.snow.snow,
               'load.ice': session.snow.ice}
        for name, value in now.items():
            if self.parameters[name] != value:
                self.parameters.tell(name, value)

    def _report(self) -> None:
        """Log and publish the state; called once a second."""
        self.diagnostics.publish()
        self._tell_end()
        for work in self._watched:
            work.look()
        self._warn_of_others()
        self._warn_of_unheard()
        if self._has_status_line:
            self._print_status()

    def _tell_end(self) -> None:
        """Log once why the node has ended, for a process that goes on."""
        error = self.loop.ended.exception() if self.loop.ended.done() else None
        if error is not None and not self.has_told_end:
            self.has_told_end = True
            self.session.without_scene = f'the node has ended: {error}'
            self.get_logger().fatal(self.session.without_scene)

    def _warn_of_others(self) -> None:
        """Log once if other nodes publish the time, too, or have the name of this one."""
        clocks = self._output.clocks
        if clocks > max(self._clocks, 1):
            self.get_logger().warning(f'{clocks} nodes publish /clock, time will jump for all '
                                      'that use it; start all but one with publish_clock:=false')
        self._clocks = clocks
        own = self.get_name(), self.get_namespace()
        namesakes = self.get_node_names_and_namespaces().count(own)
        if namesakes > max(self._namesakes, 1):
            self.get_logger().warning(
                f'{namesakes} nodes are called {self.get_fully_qualified_name()}: any of them may '
                'answer a service, and their topics mix; give this one another name with '
                '-r __node:=NAME')
        self._namesakes = namesakes

    def _warn_of_unheard(self) -> None:
        """Log once for each topic if commands on it are not received."""
        for topic, (sender, reason) in self.receiver.unheard().items():
            if topic not in self._unheard:
                self.get_logger().warning(
                    f'{sender} publishes {topic}, which is not heard: {reason}; change the '
                    'quality of service there, or here at start, such as '
                    f'qos_overrides.{topic}.subscription.reliability:=best_effort')
                self._unheard.add(topic)

    def _print_status(self) -> None:
        try:
            print(status_line(self.diagnostics.latest, self.diagnostics.factor,
                              self.builder.activity.now()), flush=True)
        except OSError as error:  # its reader has gone, or the disk is full
            self._has_status_line = False
            self.get_logger().warning(f'no more status lines: {error.strerror}')

    def report_defect(self, error: Exception) -> None:
        """Log an error in the ROS thread, which goes on."""
        self.get_logger().error(f'a message or a request was dropped: {describe(error)}',
                                throttle_duration_sec=_WARNING_PERIOD)
        self._log_traceback(error)

    def _report_rejection(self, name: str, reason: str, defect: Exception | None) -> None:
        if not self.context.ok():  # ROS was shut down, and interrupted the command
            return
        if self._warnings.is_due():  # the logger's own throttle takes 0.2 ms per call
            self.get_logger().warning(f'{name} rejected: {reason}')
        if defect is not None:
            self._log_traceback(defect)

    def _log_traceback(self, error: Exception) -> None:
        self.get_logger().debug(''.join(format_exception(error)))

    def _warn_about_settings(self) -> None:
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning('use_sim_time changes nothing: this node keeps its own '
                                      'time, whoever publishes /clock')
        for line in self.parameters.unused_overrides():
            self.get_logger().warning(line)
        if self.parameters.is_demo:
            self.get_logger().info(f'no scene was given, this is the demo; give another with '
                                   f'--ros-args --params-file {shared_folder()}/config/<scene>'
                                   '.yaml')


def banner(node: SimNode) -> str:
    """Describe the scene and its topics, with remapped names."""
    everywhere = ('/rosout', '/parameter_events')
    topics = node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())
    sent = sorted(topic for topic, _ in topics
                  if topic not in everywhere and '/_' not in topic)
    return '\n'.join((node.session.summary(), f'  out  {" ".join(sent)}',
                      f'  in   {" ".join(node.receiver.names)}', '  stop with Ctrl-C'))
