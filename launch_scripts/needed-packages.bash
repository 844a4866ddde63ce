# What musselbed needs, for launch_scripts/install, make-field-kit, container and test, which source this.
debian_packages=(
  python3 python3-venv
  python3-rospy python3-rosmaster python3-roslaunch python3-rosbag python3-rostopic python3-rosservice python3-rosnode
  python3-rosmsg python3-rosparam python3-rosgraph-msgs python3-actionlib python3-std-srvs rosbash
  # what RViz, rqt, PlotJuggler and Foxglove show without code
  python3-sensor-msgs python3-nav-msgs python3-visualization-msgs python3-diagnostic-msgs python3-tf2-msgs
  # the texts of messages, with the package.xml by which rosmsg finds them, and genaction
  ros-std-msgs ros-geometry-msgs ros-actionlib-msgs ros-rosgraph-msgs ros-std-srvs
  libstd-msgs-dev libgeometry-msgs-dev libactionlib-msgs-dev libros-rosgraph-msgs-dev libstd-srvs-dev
  ros-sensor-msgs ros-nav-msgs ros-visualization-msgs ros-diagnostic-msgs ros-tf2-msgs
  libsensor-msgs-dev libnav-msgs-dev libvisualization-msgs-dev libdiagnostic-msgs-dev libtf2-msgs-dev
)
# The modules of Debian's Python that .venv sees: ROS, and those that ROS imports and no pinned package brings. Any other one
# could shadow a pinned package. Message packages are all seen, since a scenario may name a type of any of them.
debian_modules=(
  rospy rosbag roslaunch rosmaster rosnode rostopic rosservice rosmsg rosparam rosgraph roslib rosclean roslz4 rospkg roscpp
  actionlib genpy genmsg catkin catkin_pkg '*_msgs' '*_srvs'
  Cryptodome defusedxml gnupg netifaces
  # its version, for the records of a run
  'rospy-*.egg-info'
)
# The extras of setup.cfg.
extras=studies,export,imc,foxglove
# The wheels of ROS 2, for an environment of their own: the first one publishes, the others read what it publishes.
ros2_packages=('ros-rclpy[fastrtps]' ros-sensor-msgs ros-geometry-msgs ros-nav-msgs ros-std-msgs ros-visualization-msgs
  ros-diagnostic-msgs ros-rosgraph-msgs)
# The Pythons of Debian 12 and 13, for which launch_scripts/make-lock pins versions.
pinned_pythons="3.11 3.13"
# Prints the version of Debian's Python, as 3.11.
debian_python() { /usr/bin/python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }
# Prints the release and the processor, as `debian 13, x86_64`.
machine() { (. /etc/os-release && echo "$ID ${VERSION_ID:-$VERSION_CODENAME}, $(uname -m)"); }
# Prints the file of pinned versions and hashes, $1 being run, mu, test or ros2; nothing for a Python or processor without pins.
pinned_versions() {
  local file=launch_scripts/requirements/$(debian_python)/$1.txt
  [ "$(uname -m)" != x86_64 ] || [ ! -e "$file" ] || echo "$file"
}
# The mirror from which this machine takes Debian's packages, by the lists that apt has read.
debian_mirror() {
  # shellcheck disable=SC2016  # the names are apt's
  apt-get indextargets --format '$(LABEL) $(COMPONENT) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
    sed -n 's/^Debian main //p' | sed -n 1p
}
