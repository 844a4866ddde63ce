# scenario: ../scenarios/bay-24.yaml
lat = api.get_location(24).lat
lon = api.get_location(24).lon
api.go_to([lat, lon])
while (api.goto_status(id_self) == 1):
    print('GoTo in progress.')
    time.sleep(1)
print("Goal reached. Docking start.")
api.docking(True, 2, 24)
