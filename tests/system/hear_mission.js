// Hears /musselbed/mission by rosnodejs until its standard input ends, and then prints [mission time, kind] of each event.
const rosnodejs = require("rosnodejs");

rosnodejs.initNode("/somebody_else", { logging: { skipRosLogging: true }, onTheFly: true }).then((node) => {
  const heard = [];
  node.subscribe("/musselbed/mission", "musselbed_msgs/MissionEvent", (it) => heard.push([Number(it.mission_time_ms), it.kind]), { queueSize: 1000 });
  console.log("listening");
  process.stdin.resume().on("end", () => { console.log(JSON.stringify(heard)); process.exit(0); });
});
