# What musselbed needs, for launch_scripts/install and launch_scripts/make-field-kit, which source this.
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
# The extras of setup.cfg.
extras=studies,export,imc
# Prints the file of pinned versions and hashes, $1 being run or test; nothing on a processor for which none are pinned.
pinned_versions() { [ "$(uname -m)" != x86_64 ] || echo "launch_scripts/requirements/$1.txt"; }
